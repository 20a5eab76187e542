"""The nearest pairs in the core: proved by corners and coal; those from the cache are the same."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from tests import urdf
from tests.conftest import random_state
from tests.robot.by_coal import all_pairs
from tests.robot.formats import mjcf_texts as mjcf
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.files import cache_folder
from wbc.robot import Robot
from wbc.robot.collision import (
    CollisionModel,
    Selection,
    cached_pairs,
    chosen_pairs,
    robot_bodies,
    select_pairs,
)
from wbc.robot.collision.distances import ShapePairs
from wbc.robot.collision.shapes import Body, Capsule, Hull

CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def some_pairs(bodies, rng: np.random.Generator) -> list[tuple[int, int]]:
    """150 pairs of bodies on different joints, in order."""
    every = all_pairs(bodies)
    return [every[k] for k in sorted(rng.permutation(len(every))[:150].tolist())]


def test_hulls_are_certified_and_coals(rng) -> None:
    """Corners prove the distance: none of one hull is beyond a plane, none of the other before it.

    Between these planes it can be no less, between the points found no more. coal stops within its
    tolerance of 1e-7 m.
    """
    robot = Robot.load("hoap2_like")
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
    pairs = some_pairs(bodies, rng)
    model, coals = CollisionModel(robot, bodies, pairs), ShapePairs(bodies, np.array(pairs))
    certified = handed = 0
    for _ in range(20):
        q, _ = random_state(robot, rng)
        here = robot.snapshot(q)
        R, p = here.joint_placements
        expected = coals.measure(here, np.arange(len(pairs)))[0]
        for k, (a, b) in enumerate(pairs):
            found = model.native.measure(here.native_state, np.array([k]))
            if found[0, 0] == -np.inf:  # the cores touch
                thickness = sum(bodies[i].shape.radius for i in (a, b))
                assert expected[k] < 1e-6 - thickness
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
            assert distance == pytest.approx(expected[k], abs=3e-7)
            certified += 1
    assert certified > 1500
    assert handed > 20


@pytest.mark.parametrize("tilt", [0.0, 1e-10, 1e-8, 1e-6])
def test_boxes_with_parallel_faces_are_measured(tilt: float, rng) -> None:
    """Nearest points of such faces are not unique; an upright robot of boxes has many of them."""
    robot = Robot.load("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    joints, gaps, bodies = (5, 20), rng.choice([1e-4, 5e-3, 0.1], 200), []
    R, p = here.joint_placements
    for k, gap in enumerate(gaps):
        axes = Rotation.random(random_state=rng).as_matrix()
        sizes = rng.uniform(0.01, 0.2, (2, 3))
        aside = rng.uniform(-0.8, 0.8, 2) * sizes[:, 1:].sum(axis=0)
        middles = np.zeros(3), axes @ (sizes[:, 0].sum() + gap, *aside)
        turns = axes, axes @ Rotation.from_rotvec(tilt * rng.normal(size=3)).as_matrix()
        for joint, size, middle, turn in zip(joints, sizes, middles, turns, strict=True):
            corners = middle + (CORNERS * size) @ turn.T
            hull = Hull((corners - p[joint]) @ R[joint], 0.0)
            bodies.append(Body(f"{k} on {joint}", "base", joint, hull))
    pairs = [(2 * k, 2 * k + 1) for k in range(len(gaps))]
    model = CollisionModel(robot, bodies, pairs)
    found = model.native.measure(here.native_state, np.arange(len(pairs)))
    np.testing.assert_allclose(found[0], gaps, atol=2e-9 + tilt)


def test_what_pairs_keep_and_those_that_touch(rng) -> None:
    """The least clearances of all pairs; only where bodies touch are they coal's (1e-7 m)."""
    robot = Robot.load("hoap2_like")
    bodies = []
    for joint in range(1, robot.model.njoints):
        points = 0.1 * rng.normal(size=3) + rng.uniform(0.01, 0.05) * rng.normal(size=(20, 3))
        corners = points[ConvexHull(points).vertices]
        bodies.append(Body(str(joint), "base", joint, Hull(corners, 0.01 * (joint % 2))))
    pairs = some_pairs(bodies, rng)
    ours, theirs = CollisionModel(robot, bodies, pairs), ShapePairs(bodies, np.array(pairs))
    kept, count, touching = 0.1 * rng.random(len(pairs)), 50, 0
    for _ in range(10):
        q, _ = random_state(robot, rng)
        here = robot.snapshot(q)
        every = theirs.measure(here, np.arange(len(pairs)))[0] - kept
        found = ours.nearest(here, count, kept)
        clearance = found.distance - kept[found.pairs]
        np.testing.assert_allclose(np.sort(clearance), np.sort(every)[:count], atol=1e-6)
        np.testing.assert_allclose(clearance, every[found.pairs], atol=1e-6)
        assert (np.diff(found.pairs) > 0).all()
        core = ours.native.nearest(here.native_state, count, kept)
        touching += 0 if core is None else np.count_nonzero(np.isneginf(core[1][0]))
        again = ours.measure(here, found.pairs)
        np.testing.assert_allclose(again.distance, found.distance, atol=1e-12)
    assert touching > 50


def test_pairs_as_far_as_the_farthest_do_not_hide_nearer_ones() -> None:
    """Three of the same distance come first, one that is nearer last."""
    robot = Robot.load("hoap2_like")
    here = robot.snapshot(robot.posture())
    own = Body("own", "base", 1, Capsule.sphere([0.0, 0.0, 0.0], 0.01))
    centre = here.joint_placements[1][1]
    places = [[0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.3], [0.1, 0.0, 0.0]]
    others = [Body("", "", 0, Capsule.sphere(centre + place, 0.01)) for place in places]
    model = CollisionModel(robot, [own, *others], [(0, k) for k in range(1, 5)])
    found = model.nearest(here, 2)
    assert found.pairs.tolist() == [0, 3]
    np.testing.assert_allclose(found.distance, [0.28, 0.08], atol=1e-12)


def test_spheres_about_one_point_are_in_each_other_by_both_radii() -> None:
    """No direction is between them: any is taken."""
    robot = Robot.load("hoap2_like")
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
    for found in (model.nearest(here, 1), model.measure(here, np.array([0]))):
        assert found.pairs.tolist() == [0]
        assert found.distance[0] == pytest.approx(-0.02)
        assert np.linalg.norm(found.normal[0]) == pytest.approx(1.0)


@pytest.mark.parametrize("how", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
@pytest.mark.parametrize("shape", [Capsule.sphere(np.zeros(3), 0.02), Hull.box([0.02, 0.03, 0.04])])
@pytest.mark.parametrize("away", [1.0, 0.0])
def test_a_copy_has_its_own_bodies(hoap2: Robot, how, shape: Capsule | Hull, away: float) -> None:
    """Apart, and within each other: coal's own results can be neither copied nor pickled."""
    here = hoap2.snapshot(hoap2.posture())
    ball = Body("own", "base", 1, Capsule.sphere(np.zeros(3), 0.01))
    model = CollisionModel(hoap2, [ball, Body("other", "", 0, shape)], [(0, 1)])
    place = here.position("base") + [away, 0.0, 0.0]
    model.place(1, np.eye(3), place)
    before = model.nearest(here).distance
    other = how(model)
    model.place(1, np.eye(3), place + [2.0, 0.0, 0.0])
    assert model.nearest(here).distance > 1.9
    near = other.nearest(other.robot.snapshot(hoap2.posture())).distance
    np.testing.assert_array_equal(near, before)


OBJ = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.{0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
MESH = urdf.collision('mesh filename="part.obj"')
THREE = urdf.robot(
    "three",
    *(urdf.link(name, MESH) for name in "abc"),
    urdf.joint("ab", "a", "b", at="0 0 .3", axis="1 0 0"),
    urdf.joint("bc", "b", "c", at="0 0 .3", axis="1 0 0", limit=urdf.limit(2)),
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.setenv("WBC_CACHE", str(tmp_path / "cache"))
    (tmp_path / "part.obj").write_text(OBJ.format(1))
    (tmp_path / "r.urdf").write_text(THREE)
    return tmp_path


def same(one: Selection, other: Selection) -> bool:
    alike = (one.pairs, one.margins, one.excluded, one.finer) == (
        other.pairs, other.margins, other.excluded, other.finer)  # fmt: skip
    cores = zip(one.bodies, other.bodies, strict=True)
    return alike and all(
        a.shape.core.tobytes() == b.shape.core.tobytes()
        and a.shape.radius == b.shape.radius
        and (a.name, a.link, a.joint, a.bulge) == (b.name, b.link, b.joint, b.bulge)
        for a, b in cores
    )


def test_what_is_found_again_is_what_was_made_and_reads_no_mesh(folder: Path, monkeypatch) -> None:
    robot = Robot.load(folder / "r.urdf")
    first = chosen_pairs(robot, clearance=0.01)
    assert first.pairs == ((0, 2),)
    assert same(first, select_pairs(robot, robot_bodies(robot), clearance=0.01))
    again = Robot.load(folder / "r.urdf")
    monkeypatch.setattr(cached_pairs, "robot_bodies", None)
    monkeypatch.setattr(cached_pairs, "select_pairs", None)
    assert same(first, chosen_pairs(again, clearance=0.01))
    assert not {"collision_model", "collision_surfaces"} & vars(again).keys()  # no mesh was read


def test_whatever_it_depends_on_makes_another(folder: Path, monkeypatch) -> None:
    made = []
    monkeypatch.setattr(
        cached_pairs, "select_pairs", lambda *a, **k: made.append(k) or select_pairs(*a, **k)
    )

    def count(*arguments, **options) -> int:
        before = len(made)
        chosen_pairs(Robot.load(folder / "r.urdf"), *arguments, **options)
        return len(made) - before

    assert count() == 1 and count() == 0
    assert count(clearance=0.02) == 1 and count("hull") == 1
    assert count(exclude=[("a", "c")]) == 1 and count(exclude=iter([("a", "c")])) == 0
    (folder / "part.obj").write_text(OBJ.format(2))
    assert count() == 1 and count() == 0
    text = (folder / "r.urdf").read_text()
    (folder / "r.urdf").write_text(text.replace('upper="2"', 'upper="1.5"'))
    assert count() == 1 and count() == 0
    entries = sorted((folder / "cache" / "collision").iterdir())
    for entry in entries:  # damaged, all of them: made anew
        entry.write_bytes(entry.read_bytes()[:-3])
    assert count() == 1 and count() == 0
    monkeypatch.setenv("WBC_CACHE", "off")
    assert count() == 1 and count() == 1


def test_a_folder_that_cannot_be_written_to_is_left_alone(folder: Path, monkeypatch) -> None:
    (folder / "file").write_text("not a folder")
    monkeypatch.setenv("WBC_CACHE", str(folder / "file"))
    assert chosen_pairs(Robot.load(folder / "r.urdf")).pairs
    monkeypatch.delenv("WBC_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "home"))
    assert cache_folder() == folder / "home" / "wbc" / "collision"
    assert not (folder / "home").exists()  # nothing was made by asking


def test_mistakes_are_those_of_what_is_cached(folder: Path) -> None:
    robot = Robot.load(folder / "r.urdf")
    with pytest.raises(UnknownNameError):
        chosen_pairs(robot, include=[("nothing", "a")])
    with pytest.raises(InvalidInputError, match="expected a list of two links"):
        chosen_pairs(robot, exclude=3)  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError):
        chosen_pairs(robot, "ball")


def test_mujoco_models_are_kept_too(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("WBC_CACHE", str(tmp_path / "cache"))
    (tmp_path / "r.xml").write_text(mjcf.text(mjcf.LEGS))
    one = chosen_pairs(Robot.load(tmp_path / "r.xml"))
    entries = list((tmp_path / "cache" / "collision").iterdir())
    two = chosen_pairs(Robot.load(tmp_path / "r.xml"))
    assert same(one, two) and entries == list((tmp_path / "cache" / "collision").iterdir())
    assert np.isfinite(one.bodies[0].shape.core).all()
