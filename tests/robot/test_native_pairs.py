"""The nearest pairs in the native core against those by arrays, on the same bodies and states."""

import copy
import pickle

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from tests.conftest import ROBOTS, load, random_state
from wbc.robot import Robot
from wbc.robot.collision import CollisionModel, robot_bodies, select_pairs
from wbc.robot.collision.shapes import Body, Capsule, HalfSpace, Hull


def loaded(name: str) -> Robot:
    return Robot.load(name if name in ROBOTS[:-1] else load(name).path)


def both(robot: Robot, bodies, pairs) -> list[CollisionModel]:
    """Return a model in the core, and the same by arrays, as where there are half-spaces."""
    models = [CollisionModel(robot, bodies, pairs) for _ in range(2)]
    assert models[0].native is not None
    models[1].native = None
    return models


def random_pairs(bodies, rng: np.random.Generator, most: int) -> list[tuple[int, int]]:
    """Some pairs of bodies on different joints, in order."""
    every = [
        (a, b)
        for a in range(len(bodies))
        for b in range(a + 1, len(bodies))
        if bodies[a].joint != bodies[b].joint
    ]
    chosen = rng.permutation(len(every))[:most]
    return [every[k] for k in sorted(chosen.tolist())]


def assert_same(fast: CollisionModel, plain: CollisionModel, states, count: int) -> int:
    """Pairs, distances, normals, points and Jacobians; return how many pairs are inside another.

    Sums in another order: 1e-12 m. Normals of axes that nearly touch lose what these are short of.
    """
    inside = 0
    for q, v in states:
        here, there = fast.robot.snapshot(q, v), plain.robot.snapshot(q, v)
        ours, theirs = fast.nearest(here, count), plain.nearest(there, count)
        np.testing.assert_array_equal(ours.pairs, theirs.pairs)
        np.testing.assert_allclose(ours.distance, theirs.distance, rtol=0.0, atol=1e-12)
        for field in ("normal", "point"):
            a, b = getattr(ours, field), getattr(theirs, field)
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-8)
        rows = fast.rows(here, ours), plain.rows(there, theirs)
        scale = max(1.0, np.abs(rows[1]).max(initial=0.0))
        np.testing.assert_allclose(*rows, rtol=0.0, atol=1e-8 * scale)
        inside += np.count_nonzero(ours.distance < 0.0)
    return inside


@pytest.mark.parametrize("name", ["g1", "talos", "romeo", "hoap2_like"])
def test_the_same_pairs_at_random_states(name: str, rng) -> None:
    """Capsules, with some hulls among them."""
    robot = loaded(name)
    bodies = []
    for joint in range(1, robot.model.njoints):
        ends, radius = rng.uniform(-0.1, 0.1, (2, 3)), rng.uniform(0.01, 0.08)
        ends[1] = ends[0] if joint % 5 == 0 else ends[1]  # spheres among them
        bodies.append(Body(f"capsule {joint}", "base", joint, Capsule(ends, radius)))
    corners = 0.1 * rng.normal(size=(2, 8, 3))
    bodies += [Body(f"hull {k}", "base", 2 + k, Hull(corners[k])) for k in range(2)]
    pairs = random_pairs(bodies, rng, 400)
    models = both(robot, bodies, pairs)
    assert models[0].native is not None
    states = [random_state(robot, rng) for _ in range(15)]
    inside = sum(assert_same(*models, states, count) for count in (1, 7, 25, len(pairs)))
    assert inside > 10


def test_hulls_are_certified_and_coals(rng) -> None:
    """Corners prove the distance: none of one hull is beyond a plane, none of the other before it.

    Between these planes it can be no less, between the points found no more. coal stops within its
    tolerance of 1e-7 m.
    """
    robot = loaded("hoap2_like")
    bodies = []
    for joint in range(1, robot.model.njoints):
        place, size = 0.1 * rng.normal(size=3), rng.uniform(0.01, 0.1)
        points = place + size * rng.normal(size=(40, 3))
        shapes = (
            Hull(points[ConvexHull(points).vertices], 0.01),
            Hull.box([size, 0.05, 0.02], place),
            Capsule.of(place, place + size, 0.03),
            Capsule.sphere(place, 0.03),
        )
        bodies.append(Body(str(joint), "base", joint, shapes[joint % 4]))
    pairs = random_pairs(bodies, rng, 150)
    models = both(robot, bodies, pairs)
    certified = handed = 0
    for _ in range(20):
        q, _ = random_state(robot, rng)
        here, there = robot.snapshot(q), robot.snapshot(q)
        R, p = here.joint_placements
        expected = models[1].measure(there, np.arange(len(pairs)))
        for k, (a, b) in enumerate(pairs):
            found = models[0].native.measure(here.native_state, np.array([k]))
            if found[0, 0] == -np.inf:  # the cores touch
                thickness = sum(bodies[i].shape.radius for i in (a, b))
                assert expected.distance[k] < 1e-6 - thickness
                handed += 1
                continue
            distance, n, point = found[0, 0], found[1:4, 0], found[4:, 0]
            ahead = [
                bodies[i].shape.core @ R[bodies[i].joint].T + p[bodies[i].joint] for i in (a, b)
            ]
            gap = (ahead[0] @ n).min() - (ahead[1] @ n).max()
            radii = bodies[a].shape.radius, bodies[b].shape.radius
            assert distance == pytest.approx(gap - sum(radii), abs=2e-10)
            assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
            assert (ahead[0] @ n).min() - radii[0] == pytest.approx(point @ n, abs=2e-10)
            assert distance == pytest.approx(expected.distance[k], abs=3e-7)
            certified += 1
    assert certified > 1500
    assert handed > 20


def test_what_pairs_keep_and_those_that_touch(rng) -> None:
    """The least clearances of all pairs; only where bodies touch are they coal's (1e-7 m)."""
    robot = loaded("hoap2_like")
    bodies = []
    for joint in range(1, robot.model.njoints):
        points = 0.1 * rng.normal(size=3) + rng.uniform(0.01, 0.05) * rng.normal(size=(20, 3))
        corners = points[ConvexHull(points).vertices]
        bodies.append(Body(str(joint), "base", joint, Hull(corners, 0.01 * (joint % 2))))
    pairs = random_pairs(bodies, rng, 150)
    ours, theirs = both(robot, bodies, pairs)
    kept, count, touching = 0.1 * rng.random(len(pairs)), 50, 0
    for _ in range(10):
        q, _ = random_state(robot, rng)
        here, there = robot.snapshot(q), robot.snapshot(q)
        every = theirs.measure(there, np.arange(len(pairs))).distance - kept
        found, by_arrays = ours.nearest(here, count, kept), theirs.nearest(there, count, kept)
        for nearest in (found, by_arrays):
            clearance = nearest.distance - kept[nearest.pairs]
            np.testing.assert_allclose(np.sort(clearance), np.sort(every)[:count], atol=1e-6)
            np.testing.assert_allclose(clearance, every[nearest.pairs], atol=1e-6)
            assert (np.diff(nearest.pairs) > 0).all()
        core = ours.native.nearest(here.native_state, count, kept)
        touching += 0 if core is None else np.count_nonzero(np.isneginf(core[1][0]))
        again = ours.measure(here, found.pairs)
        np.testing.assert_allclose(again.distance, found.distance, atol=1e-12)
    assert touching > 50


def test_pairs_as_far_as_the_farthest_do_not_hide_nearer_ones() -> None:
    """Three of the same distance come first, one that is nearer last."""
    robot = loaded("hoap2_like")
    here = robot.snapshot(robot.posture())
    own = Body("own", "base", 1, Capsule.sphere([0.0, 0.0, 0.0], 0.01))
    centre = here.joint_placements[1][1]
    places = [[0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.3], [0.1, 0.0, 0.0]]
    others = [Body("", "", 0, Capsule.sphere(centre + place, 0.01)) for place in places]
    model = CollisionModel(robot, [own, *others], [(0, k) for k in range(1, 5)])
    found = model.nearest(here, 2)
    assert found.pairs.tolist() == [0, 3]
    np.testing.assert_allclose(found.distance, [0.28, 0.08], atol=1e-12)


def test_bodies_that_are_moved_from_outside(rng) -> None:
    robot = loaded("hoap2_like")
    joints = range(1, robot.model.njoints)
    balls = [Capsule.sphere(rng.uniform(-0.1, 0.1, 3), 0.05) for _ in joints]
    bodies = [Body(f"ball {k}", "base", k, ball) for k, ball in zip(joints, balls, strict=True)]
    own = len(bodies)
    bodies += [Body("rod", "", 0, Capsule.of([0, 0, 0], [0.3, 0, 0], 0.02))]
    bodies += [Body("ball", "", 0, Capsule.sphere([0, 0, 0], 0.05))]
    pairs = [(a, b) for a in range(own) for b in (own, own + 1)]
    models = both(robot, bodies, pairs)
    assert models[0].native is not None
    for _ in range(10):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        turn *= np.sign(np.linalg.det(turn))
        for model in models:
            model.place(own, turn, np.array([0.2, 0.1, 0.4]))
            model.place(own + 1, turn, 0.3 * turn[0])
        assert_same(*models, [random_state(robot, rng)], 5)


def test_what_it_does_not_know_is_left_to_python() -> None:
    robot = loaded("hoap2_like")
    here = robot.snapshot(robot.posture())
    # Spheres on joints whose origins are one place, and one elsewhere.
    places = here.joint_placements[1]
    first, second = next(
        (a, b)
        for a in range(1, len(places))
        for b in range(a + 1, len(places))
        if np.allclose(places[a], places[b], atol=1e-12)
    )
    ball = Capsule.sphere([0.0, 0.0, 0.0], 0.01)
    joints = (first, second, 1)
    bodies = [Body(str(k), "base", joint, ball) for k, joint in enumerate(joints)]
    model = CollisionModel(robot, bodies, [(0, 1), (0, 2)])
    state = here.native_state
    assert model.native.nearest(state, 1) is None  # axes touch: no direction between them
    assert model.nearest(here, 1).distance[0] == pytest.approx(-0.02)
    apart = CollisionModel(robot, bodies, [(0, 2), (1, 2)])
    assert apart.native.nearest(state, 2) is not None
    assert apart.native.nearest(state, 3) is None  # there are not so many
    wall = Body("wall", "", 0, HalfSpace.of([0, 0, 1], 0.0))
    assert CollisionModel(robot, [*bodies, wall], [(0, 2), (0, 3)]).native is None


@pytest.mark.parametrize("how", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_reads_its_own_bodies(how) -> None:
    robot = loaded("hoap2_like")
    ball = Capsule.sphere([0.0, 0.0, 0.0], 0.01)
    bodies = [Body("own", "base", 1, ball), Body("other", "", 0, ball), Body("far", "", 0, ball)]
    pairs = how(CollisionModel(robot, bodies, [(0, 1), (0, 2)]).native)
    here = robot.snapshot(robot.posture())
    pairs.arrays["local"][1, :, 0] = here.position("base") + [0.3, 0.0, 0.0]
    pairs.arrays["local"][1, :, 2] = here.position("base") + [0.3, 0.0, 0.0]
    _, found = pairs.nearest(here.native_state, 2)
    assert found[0, 0] == pytest.approx(0.28)


@pytest.mark.parametrize("how", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_of_bodies_that_coal_measures(how) -> None:
    """Coal's own results can be neither copied nor pickled."""
    robot = load("hoap2_like")
    ball = Capsule.sphere([0.0, 0.0, 0.0], 0.01)
    bodies = [Body("own", "base", 1, ball), Body("other", "", 0, Hull.box([0.02, 0.03, 0.04]))]
    model = CollisionModel(robot, bodies, [(0, 1)])
    model.place(1, np.eye(3), np.array([1.0, 0.0, 0.5]))
    other = how(model)
    model.place(1, np.eye(3), np.array([3.0, 0.0, 0.5]))
    far = model.nearest(robot.snapshot(robot.posture())).distance
    near = other.nearest(other.robot.snapshot(robot.posture())).distance
    model.place(1, np.eye(3), np.array([1.0, 0.0, 0.5]))
    again = model.nearest(robot.snapshot(robot.posture())).distance
    assert far > 2.5
    np.testing.assert_array_equal(near, again)


@pytest.mark.slow
def test_more_pairs_are_asked_for_at_once_while_many_bodies_touch(rng, monkeypatch) -> None:
    """What was found to be too few is not asked for first in the next look; found is the same."""
    robot = loaded("icub")
    bodies = robot_bodies(robot, "hull")
    chosen = select_pairs(robot, bodies)
    model = CollisionModel(robot, chosen.bodies, chosen.pairs)
    asked, nearest = [], model.native.nearest
    monkeypatch.setattr(
        model.native, "nearest", lambda *args: asked.append(args[1]) or nearest(*args)
    )

    def looked(q) -> tuple[list[int], list[np.ndarray]]:
        asked.clear()
        found = model.nearest(robot.snapshot(q), 25)
        return asked.copy(), list(found[:4])

    few, more, standing = 25, 100, robot.posture("standing")
    for _ in range(50):
        folded = random_state(robot, rng)[0]
        first, second = looked(folded), looked(folded)
        if first[0] == [few, more] and second[0] == [more]:
            break
        looked(standing), looked(standing)
    else:
        pytest.fail("no posture in which more pairs are needed, and enough")
    for one, other in zip(first[1], second[1], strict=True):
        np.testing.assert_array_equal(one, other)
    assert looked(standing)[0] == [more]  # where nothing touches
    assert looked(standing)[0] == [few]
