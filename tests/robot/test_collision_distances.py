"""Nearest points of segments against coal's capsules, brute force, and the degenerate cases."""

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.robot.by_coal import of_model
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.collision import Body, Capsule, CollisionModel, Obstacle, PairDistances

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


def test_many_pairs_with_degenerate_ones_among_them(rng) -> None:
    """One pair of identical points must not disturb the others."""
    ends = rng.normal(size=(4, 20, 3))
    clean = nearest(*ends)
    ends[:, 7] = 1.0
    mixed = nearest(*ends)
    rest = np.arange(20) != 7
    np.testing.assert_array_equal(mixed.distance[rest], clean.distance[rest])
    assert np.isfinite(mixed.normal).all()
    assert mixed.distance[7] == pytest.approx(0.0, abs=1e-12)


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
