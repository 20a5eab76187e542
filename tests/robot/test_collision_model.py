"""Distances, normals and rows against coal and finite differences; pairs against brute force."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests import urdf
from tests.robot.by_coal import all_pairs, bodies_on, distances, model_on, of_model
from wbc.constraints import SelfCollision
from wbc.errors import InvalidInputError, ModelError, UnknownNameError
from wbc.files import CACHE_VARIABLE
from wbc.robot import Robot
from wbc.robot.collision import (
    Body,
    Capsule,
    CollisionModel,
    HalfSpace,
    Hull,
    Obstacle,
    robot_bodies,
    select_pairs,
)


@pytest.fixture(autouse=True)
def no_cache(monkeypatch) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, "off")


@pytest.mark.parametrize("name", ["hoap2_like", "mixed_joints"])
def test_distances_of_all_kinds_of_pairs(name, robot_named, random_snapshot, rng) -> None:
    """What was asked for before, few or all, leaves nothing behind."""
    robot = robot_named(name)
    model = model_on(robot, rng)
    for size in (len(model.pairs), 3, len(model.pairs), 1, 20, 5, 0):
        here = random_snapshot(robot, rng)
        some = np.sort(rng.choice(len(model.pairs), size, replace=False))
        found = model.measure(here, some) if size < len(model.pairs) else model.nearest(here)
        np.testing.assert_array_equal(found.pairs, some)
        # Two iterations that stop at 1e-7 m; EPA, inside each other, is ten times coarser.
        expected = distances(robot, model.bodies, model.pairs[some], here.q)
        np.testing.assert_allclose(found.distance, expected, rtol=0, atol=5e-6)
        assert found.normal.shape == found.point.shape == (size, 3)
        norms = np.linalg.norm(found.normal, axis=1)
        np.testing.assert_allclose(norms, 1.0, rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", ["hoap2_like", "mixed_joints", "talos"])
def test_rows_are_the_slopes_of_coals_distances(name, robot_named, random_snapshot, rng) -> None:
    robot = robot_named(name)
    model = model_on(robot, rng)
    here = random_snapshot(robot, rng)
    found = model.nearest(here)
    rows = model.rows(here, found)
    smooth = found.distance > 1e-2  # the depth inside another shape may have kinks
    capsules = np.array([isinstance(body.shape, Capsule) for body in model.bodies])
    round_ones = capsules[model.pairs].all(axis=1)[smooth]
    for _ in range(4):
        v, h = rng.normal(size=robot.nv), 1e-4
        ahead, behind = (of_model(model, robot.integrate(here.q, v, step)) for step in (h, -h))
        slope = (ahead - behind) / (2 * h)
        error = np.abs(rows @ v - slope)[smooth]
        # Nearest points of flat faces jump, where a slope has two sides: not in nine of ten pairs.
        assert np.quantile(error, 0.9) < 5e-3 * np.abs(slope).max()
        # The curvature of a capsule's distance is below 1 / core distance: 1e-4 of step, squared.
        assert error[round_ones].max() < 1e-4 * np.abs(slope).max()


def test_witness_points_lie_on_the_surfaces(hoap2, random_snapshot, rng) -> None:
    """A small ball at either point is in touch with its body."""
    model = model_on(hoap2, rng)
    here = random_snapshot(hoap2, rng)
    found = model.nearest(here)
    apart = np.flatnonzero(found.distance > 1e-3)
    points = found.point, found.point - found.distance[:, None] * found.normal
    for side in (0, 1):
        for k in apart[::7]:
            body = model.bodies[model.pairs[k, side]]
            speck = Body("speck", "speck", 0, Capsule.sphere(points[side][k], 0.0))
            touch = distances(hoap2, [body, speck], [(0, 1)], here.q)[0]
            assert abs(touch) < 2e-5


@pytest.mark.parametrize(("name", "fit"), [("hoap2_like", "capsule"), ("icub", "hull")])
def test_the_nearest_pairs_are_those_of_brute_force(
    name, fit, robot_named, random_snapshot, rng
) -> None:
    robot = robot_named(name)
    model = SelfCollision(robot, fit=fit).model
    for _ in range(5):
        here = random_snapshot(robot, rng)
        everything = np.sort(model.nearest(here).distance)
        for count in (1, 7, 25):
            found = model.nearest(here, count)
            assert len(found.pairs) == count
            assert (np.diff(found.pairs) > 0).all()
            np.testing.assert_allclose(np.sort(found.distance), everything[:count], atol=1e-6)
            again = model.measure(here, found.pairs)
            np.testing.assert_allclose(again.distance, found.distance, rtol=0, atol=1e-6)


@pytest.mark.slow
def test_distances_depend_on_the_posture_alone(g1_27, rng) -> None:
    """Not on what was measured before, between parallel faces least of all: bit for bit."""
    model = SelfCollision(g1_27, fit="hull").model
    standing = g1_27.snapshot(g1_27.posture("standing"))
    before = model.nearest(standing, 25)
    for _ in range(5):
        step = np.concatenate((np.zeros(6), 0.5 * rng.normal(size=g1_27.nv - 6)))
        model.nearest(g1_27.snapshot(g1_27.integrate(standing.q, step, 1.0)), 25)
        again = model.nearest(standing, 25)
        for one, other in zip(before[:4], again[:4], strict=True):
            np.testing.assert_array_equal(one, other)


def test_a_half_space_against_arithmetic(hoap2, random_snapshot, rng) -> None:
    bodies = bodies_on(hoap2, rng)
    wall = Obstacle.half_space("wall", rng.normal(size=3), 0.3)
    pairs = [(k, len(bodies)) for k in range(len(bodies))]
    model = CollisionModel(hoap2, [*bodies, Body("wall", "wall", 0, wall.shape)], pairs)
    turn, shift = pin.exp3(rng.normal(size=3)), rng.normal(size=3)
    for R, p in ((np.eye(3), np.zeros(3)), (turn, shift)):
        model.place(len(bodies), R, p)
        here = random_snapshot(hoap2, rng)
        found = model.nearest(here)
        n = R @ wall.shape.normal
        offset = wall.shape.offset + n @ p
        data = hoap2.model.createData()
        pin.forwardKinematics(hoap2.model, data, here.q)
        for k, body in enumerate(bodies):
            pose = data.oMi[body.joint]
            heights = [n @ pose.act(point) - offset for point in body.shape.core]
            expected = min(heights) - body.shape.radius
            assert found.distance[k] == pytest.approx(expected, abs=1e-9)
            np.testing.assert_allclose(found.normal[k], n, rtol=0, atol=1e-9)
        few = model.nearest(here, 2)
        np.testing.assert_allclose(np.sort(few.distance), np.sort(found.distance)[:2], atol=1e-9)


def test_obstacles_of_every_shape_wherever_they_are_put(hoap2, random_snapshot, rng) -> None:
    """Placed by rotation and origin, a shape is where its moved points are."""
    bodies = bodies_on(hoap2, rng)
    shapes = [
        Capsule.sphere([0.2, 0.1, 0.3], 0.1),
        Capsule.of([0.2, 0.1, 0.3], [0.0, 0.4, 0.2], 0.05),
        Hull.box([0.2, 0.3, 0.4], [0.1, 0.2, 0.3]),
    ]
    size = len(bodies)
    around = [Body(f"o{k}", f"o{k}", 0, shape) for k, shape in enumerate(shapes)]
    pairs = [(b, size + k) for k in range(3) for b in range(size)]
    model = CollisionModel(hoap2, [*bodies, *around], pairs)
    for _ in range(3):
        R, p = pin.exp3(rng.normal(size=3)), rng.normal(size=3)
        moved = []
        for k, shape in enumerate(shapes):
            model.place(size + k, R, p)
            moved.append(Body("o", "o", 0, type(shape)(shape.core @ R.T + p, shape.radius)))
        here = random_snapshot(hoap2, rng)
        expected = distances(hoap2, [*bodies, *moved], pairs, here.q)
        found = model.nearest(here)
        np.testing.assert_allclose(found.distance, expected, rtol=0, atol=5e-6)


def test_deep_inside_each_other_everything_stays_finite(hoap2) -> None:
    shapes = [
        Capsule.sphere(np.zeros(3), 0.1),
        Capsule.of(np.zeros(3), [0.0, 0.0, 0.2], 0.1),
        Hull.box([0.1, 0.2, 0.3]),
        Hull.box([0.1, 0.2, 0.3]),
    ]
    here = hoap2.snapshot(hoap2.posture("standing"))
    R, p = here.joint_placements
    around = []
    for joint, shape in enumerate(shapes, 1):  # all four at the same place in the world
        core = (shape.core - p[joint]) @ R[joint]
        around.append(Body(f"b{joint}", "b", joint, type(shape)(core, shape.radius)))
    model = CollisionModel(hoap2, around, all_pairs(around))
    found = model.nearest(here)
    assert np.isfinite(found.distance).all()
    assert (found.distance < 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1.0, atol=1e-6)
    assert np.isfinite(model.rows(here, found)).all()


# ------------------------------------------------------------------------------ which pairs


def labels_of(bodies, pairs) -> set[str]:
    return {f"{bodies[a].name} vs {bodies[b].name}" for a, b in pairs}


def test_an_srdf_says_which_pairs_matter(robot_named) -> None:
    robot = robot_named("talos")
    bodies = robot_bodies(robot, "hull")
    chosen = select_pairs(robot, bodies)
    text = Path(robot.srdf).read_text()
    reasons = {label: why for label, why in chosen.excluded.items() if "SRDF" in why}
    assert len(reasons) > 100
    for label in list(reasons)[:50]:
        a, b = label.split(" vs ")
        assert f'link1="{a}" link2="{b}"' in text or f'link1="{b}" link2="{a}"' in text
    kept = labels_of(chosen.bodies, chosen.pairs)
    assert "arm_left_7_link vs arm_right_7_link" in kept
    assert not kept & set(chosen.excluded)


def test_without_an_srdf_adjacent_and_touching_pairs_go(hoap2) -> None:
    bodies, parents = robot_bodies(hoap2), hoap2.model.parents
    chosen = select_pairs(hoap2, bodies, clearance=0.005)
    again = select_pairs(hoap2, bodies, clearance=0.005)  # always the same postures
    assert (chosen.pairs, chosen.margins, chosen.excluded) == (
        again.pairs, again.margins, again.excluded,
    )  # fmt: skip
    for label, why in chosen.excluded.items():
        a, b = (next(x.joint for x in bodies if x.name == name) for name in label.split(" vs "))
        assert (b == parents[a] or a == parents[b]) == (why == "adjacent")
    standing = distances(hoap2, chosen.bodies, chosen.pairs, hoap2.posture("standing"))
    assert (standing > np.array(chosen.margins) - 1e-5).all()
    assert min(chosen.margins) > 1e-3
    given = [pair for pair in chosen.pairs if max(pair) < len(bodies)]
    assert len(given) + len(chosen.finer) + len(chosen.excluded) == len(all_pairs(bodies))


def test_pairs_can_be_named(hoap2) -> None:
    bodies = robot_bodies(hoap2)
    plain = select_pairs(hoap2, bodies)
    links = [body.link for body in bodies]
    first, second = "left_foot", "right_foot"
    assert {first, second} <= set(links)
    without = select_pairs(hoap2, bodies, exclude=[("right_foot", "left_f?ot")])
    gone = set(plain.pairs) - set(without.pairs)
    assert gone
    assert all({links[a], links[b]} == {first, second} for a, b in gone)
    label = next(label for label, why in plain.excluded.items() if why == "adjacent")
    names = [name.split("#")[0] for name in label.split(" vs ")]
    back = select_pairs(hoap2, bodies, include=[(names[1], names[0])])
    assert label in labels_of(back.bodies, back.pairs)
    with pytest.raises(UnknownNameError, match="left_foot"):
        select_pairs(hoap2, bodies, exclude=[("left_fot", "*")])


# ------------------------------------------------------------------------------ refusals


def robot_with(shape: str) -> Robot:
    return Robot.load(urdf.robot("one", urdf.link("trunk", shape)), feet={})


def test_a_missing_mesh_is_named() -> None:
    robot = robot_with(urdf.collision('mesh filename="package://p/meshes/trunk.stl"'))
    with pytest.raises(ModelError, match=r"package://p/meshes/trunk.stl of link 'trunk'"):
        robot_bodies(robot)


def test_no_shapes_at_all() -> None:
    with pytest.raises(ModelError, match="no collision shapes; visual ones"):
        robot_bodies(robot_with(""))
    with pytest.raises(UnknownNameError, match="capsule"):
        robot_bodies(robot_with(""), "capsul")


def test_pairs_that_make_no_sense(hoap2) -> None:
    ball, floor = Capsule.sphere(np.zeros(3), 0.1), HalfSpace.of([0, 0, 1], 0.0)
    two = [Body("a", "a", 3, ball), Body("b", "b", 3, ball)]
    ground = Body("floor", "floor", 0, floor)
    model = CollisionModel(hoap2, [two[0], ground], [(0, 1)])
    here = hoap2.snapshot(hoap2.posture("standing"))
    for mistake, said in (
        (lambda: CollisionModel(hoap2, two, [(0, 1)]), "one joint"),
        (lambda: CollisionModel(hoap2, [ground, two[0]], [(0, 1)]), "second"),
        (lambda: model.place(0, np.eye(3), np.zeros(3)), "moved by the robot"),
        (lambda: model.nearest(here, 0), "at least 1"),
        (lambda: model.nearest(here, -1), "at least 1"),
    ):
        with pytest.raises(InvalidInputError, match=said):
            mistake()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Capsule.sphere([0, 0, np.nan], 1.0), "NaN"),
        (lambda: Capsule.sphere([0, 0, 0], -1.0), "radius"),
        (lambda: Hull.box([1.0, 0.0, 1.0]), "positive"),
        (lambda: HalfSpace.of([0, 0, 0], 1.0), "zero"),
        (lambda: Obstacle.sphere("b", [0, 0, 0], 1.0).move(2 * np.eye(3), [0, 0, 0]), "rotation"),
        (lambda: Obstacle.sphere("b", [0, 0, 0], 1.0).move(np.eye(3), [0, 0]), "shape"),
    ],
)
def test_bad_shapes(make, words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        make()


def test_half_a_disabled_pair_is_refused(hoap2, tmp_path: Path) -> None:
    """A <disable_collisions> that names one link only."""
    srdf = tmp_path / "r.srdf"
    srdf.write_text('<robot name="r"><disable_collisions link1="left_foot"/></robot>')
    with pytest.raises(ModelError, match="link2"):
        Robot.load(hoap2.path, srdf=srdf)


def test_a_robot_without_pairs_has_nothing_to_keep_apart() -> None:
    """Two links with a joint between them: neighbours are no pair."""
    links = (urdf.link(name, urdf.collision('sphere radius="0.1"')) for name in "ab")
    robot = Robot.load(urdf.robot("two", *links, urdf.joint("j", "a", "b")), base="floating")
    margins = SelfCollision(robot)
    assert not margins.model.labels
    rows = margins.rows(robot.snapshot(robot.posture("neutral")), 0.005)
    assert rows.matrix.shape == (0, robot.nv)
