"""Nearest points and margins by fitted and raw shapes, against coal's and brute force."""

import coal
import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize

from tests import urdf as toy
from tests.robot.by_coal import of_model
from wbc.constraints import SelfCollision
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.collision import Body, Capsule, CollisionModel, Obstacle, PairDistances, robot_bodies
from wbc.robot.collision.bodies import named_shapes
from wbc.robot.collision.distances import RawPairs

ROBOT, JOINT = Robot.load("hoap2_like"), 7
HERE = ROBOT.snapshot(ROBOT.posture())


def hung(*segments, radius: float = 0.0) -> CollisionModel:
    """Return pairs of capsules (k, 3): one of each hangs on a robot, the other on nothing."""
    R, p = (part[JOINT] for part in HERE.joint_placements)
    ends = [np.atleast_2d(one) for one in segments]
    bodies = [
        Body("", "", joint, Capsule.of(start, end, radius))
        for joint, starts, ends_ in ((JOINT, *[(one - p) @ R for one in ends[:2]]), (0, *ends[2:]))
        for start, end in zip(starts, ends_, strict=True)
    ]
    count = len(bodies) // 2
    return CollisionModel(ROBOT, bodies, [(k, count + k) for k in range(count)])


def nearest(a0, a1, b0, b1) -> PairDistances:
    model = hung(a0, a1, b0, b1)
    return model.measure(HERE, np.arange(len(model.pairs)))


def by_search(a0, a1, b0, b1) -> float:
    """Smallest distance over both parameters, from many starts: no formula is shared."""

    def squared(x):
        return float(np.sum((a0 + x[0] * (a1 - a0) - b0 - x[1] * (b1 - b0)) ** 2))

    starts = [(s, t) for s in (0.1, 0.9) for t in (0.1, 0.9)]
    found = [minimize(squared, x, bounds=[(0, 1)] * 2, tol=1e-16).fun for x in starts]
    return float(np.sqrt(min(found)))


def test_random_segments_against_coal(rng) -> None:
    ends = rng.normal(size=(4, 300, 3))
    found = nearest(*ends)
    expected = of_model(hung(*ends, radius=0.05), HERE.q) + 2 * 0.05
    # coal's iteration stops within 1e-6 m.
    np.testing.assert_allclose(found.distance, expected, rtol=0, atol=2e-6)
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1.0, rtol=0, atol=1e-12)


def test_points_and_normals_say_the_same_as_the_distance(rng) -> None:
    """point - distance * normal lies on the other segment, and the point on its own."""
    a0, a1, b0, b1 = rng.normal(size=(4, 200, 3))
    found = nearest(a0, a1, b0, b1)
    other = found.point - found.distance[:, None] * found.normal
    for point, start, end in ((found.point, a0, a1), (other, b0, b1)):
        to_segment = nearest(point, point, start, end).distance
        np.testing.assert_allclose(to_segment, 0.0, rtol=0, atol=1e-12)


PARALLEL = [
    ((0, 0, 0), (1, 0, 0), (0.2, 0.3, 0), (0.9, 0.3, 0)),  # side by side
    ((0, 0, 0), (1, 0, 0), (2.0, 0.3, 0), (3.0, 0.3, 0)),  # one after the other
    ((0, 0, 0), (1, 0, 0), (3.0, 0.0, 0), (2.0, 0.0, 0)),  # on one line, opposite
    ((0, 0, 0), (1, 0, 0), (0.5, 1e-7, 0.2), (1.5, -1e-7, 0.2)),  # almost
    ((0, 0, 0), (0, 0, 0), (0.5, 0.5, 0), (1.0, 0.5, 0)),  # a point and a segment
    ((0, 0, 0), (1, 0, 0), (0.5, 0.5, 0), (0.5, 0.5, 0)),  # a segment and a point
    ((0, 0, 0), (0, 0, 0), (0.3, 0, 0.4), (0.3, 0, 0.4)),  # two points
    ((0, 0, 0), (1e-9, 0, 0), (0, 1, 0), (1, 1, 0)),  # almost a point
]


@pytest.mark.parametrize("ends", PARALLEL)
def test_degenerate_segments(ends) -> None:
    a0, a1, b0, b1 = (np.array(end, dtype=float) for end in ends)
    found = nearest(a0, a1, b0, b1)
    expected = by_search(a0, a1, b0, b1)
    assert found.distance[0] == pytest.approx(expected, abs=1e-7)
    assert np.linalg.norm(found.normal[0]) == pytest.approx(1.0, abs=1e-12)


TOUCHING = [
    ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0)),  # crossing
    ((0, 0, 0), (1, 0, 0), (0.2, 0, 0), (2, 0, 0)),  # overlapping on one line
    ((0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0)),  # one point
    ((0, 0, 0), (0, 0, 0), (-1, 0, 0), (1, 0, 0)),  # a point on a segment
    ((0, 0, 0), (1, 0, 0), (0, 0, 0), (1, 0, 0)),  # the same
    ((0, 0, 0), (0, 0, 1), (0, 0, 0), (0, 0, 3)),  # along the fallback's first choice
]


@pytest.mark.parametrize("ends", TOUCHING)
def test_touching_axes_have_a_normal_all_the_same(ends) -> None:
    found = nearest(*(np.array(end, dtype=float) for end in ends))
    assert found.distance[0] == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(found.normal[0]) == pytest.approx(1.0, abs=1e-12)
    # Any motion along the normal parts them as fast as it can: both axes are across it.
    for start, end in (ends[:2], ends[2:]):
        assert found.normal[0] @ (np.subtract(end, start)) == pytest.approx(0.0, abs=1e-12)


def test_the_normal_is_continuous_up_to_touching() -> None:
    """Two crossing axes that come nearer and nearer: the same normal all the way down to 0."""
    for height in (1e-1, 1e-4, 1e-8, 1e-12, 0.0):
        a0, a1 = np.array([-1.0, 0.1, height]), np.array([1.0, 0.1, height])
        found = nearest(a0, a1, np.array([0.0, -1.0, 0.0]), np.array([0.0, 1.0, -1e-3 * height]))
        assert abs(found.normal[0, 2]) == pytest.approx(1.0, abs=1e-6)


def test_what_an_obstacle_cannot_be_assigned_is_refused() -> None:
    """Before, ``obstacle.position = ...`` was taken, and the obstacle stayed where it was."""
    ball = Obstacle.sphere("ball", (1.0, 0.0, 1.0), 0.1)
    wrong = {"position": (0, 0, 1), "shape": ball.shape, "origin": (0, np.nan, 1)}
    for name, value in (*wrong.items(), ("velocity", (1, 2)), ("rotation", 2.0 * np.eye(3))):
        with pytest.raises(InvalidInputError, match=f"{name}"):
            setattr(ball, name, value)
    ball.move(np.eye(3), (0.5, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))
    ball.advance(0.5)
    np.testing.assert_array_equal(ball.origin, (1.0, 0.0, 0.0))
    ball.origin = [0, 0, 2]
    np.testing.assert_array_equal(ball.origin, (0.0, 0.0, 2.0))
    with pytest.raises(InvalidInputError, match="expected a shape"):
        Obstacle("ball", 3)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="obstacle, name"):
        Obstacle("", ball.shape)


@pytest.mark.slow
def test_pairs_are_apart_by_their_files(g1: Robot, rng: np.random.Generator) -> None:
    collision = SelfCollision(g1, margin=0.01, pairs=10_000)
    labels, model = collision.model.labels, g1.collision_model
    raw = RawPairs(g1, collision.model.bodies, collision.model.pairs)
    placed = pin.GeometryData(model)
    index = {name: model.getGeometryId(shape.name) for name, _, shape in named_shapes(g1)}
    chosen = [k for k, label in enumerate(labels) if "hip" in label][::3]
    near = 0
    for _ in range(6):
        step = np.concatenate((np.zeros(6), 1.2 * rng.normal(size=g1.nv - 6)))
        q = g1.integrate(g1.postures["standing"], step, 1.0)
        pin.updateGeometryPlacements(g1.model, g1.model.createData(), model, placed, q)
        clearance = collision.distances(g1.snapshot(q)).clearance
        for k in chosen:
            a, b = (index[one.partition("/")[0]] for one in labels[k].split(" vs "))
            shapes = (
                (model.geometryObjects[n].geometry, coal.Transform3s(T.rotation, T.translation))
                for n, T in ((a, placed.oMg[a]), (b, placed.oMg[b]))
            )
            (first, at), (second, there) = shapes
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            distance = coal.distance(first, at, second, there, request, result)
            margin = float(collision.margins[k])
            if abs(distance - margin) > 1e-6:  # rounding of Coal's
                near += distance < margin
                by, *normal = raw.violations(q, [k], collision.margins)[0][:4]
                assert by == pytest.approx(max(margin - distance, 0.0), abs=1e-9)
                if 0.0 < distance < margin:
                    way = result.getNearestPoint1() - result.getNearestPoint2()
                    assert normal == pytest.approx(way / distance, abs=1e-4)
            # Fitted shapes contain raw ones: what they keep, these do.
            if clearance[k] > 0.0:
                assert not raw.violations(q, [k], collision.margins).any(), labels[k]
    assert near > 0


def test_links_may_have_slashes_and_words_of_labels_in_their_names() -> None:
    """As those of a robot that MuJoCo attaches to a scene; a box each, 0.3 m from face to face."""
    names = ("r2/waist", "r2/head vs tail")
    box = toy.collision("box size='0.2 0.2 0.2'")
    links = (toy.link(name, box) for name in names)
    robot = Robot.load(toy.robot("r", *links, toy.joint("j", *names, at="0 0 0.5")), feet={})
    model = CollisionModel(robot, robot_bodies(robot), [(1, 0)])
    found = model.raw.violations(robot.postures["neutral"], [0], np.array([0.4]))
    np.testing.assert_allclose(found[0, :4], (0.1, 0.0, 0.0, 1.0), atol=1e-6)
