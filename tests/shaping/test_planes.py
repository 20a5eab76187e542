"""Planes between bodies: what the rows say against coal's distances, slopes by differences."""

import casadi as ca
import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from wbc.shaping.planes import ENTRIES, UNKNOWNS, PlaneRows, Side, Slot, plane_rows

BOX = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.05, 0.05)])
SEGMENT = np.array([[0.0, 0.0, -0.2], [0.0, 0.0, 0.2]])
NORMAL = np.array([0.0, 0.6, 0.8])


def random_placements(rng: np.random.Generator, count: int) -> np.ndarray:
    """R by columns, then p, for each."""
    placed = [
        np.concatenate(
            (Rotation.random(random_state=rng).as_matrix().T.ravel(), rng.normal(size=3))
        )
        for _ in range(count)
    ]
    return np.concatenate(placed)


def coal_shape(points: np.ndarray) -> coal.CollisionGeometry:
    if len(points) == 2:
        return coal.Capsule(1e-9, float(np.linalg.norm(points[1] - points[0])))
    corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in points:
        corners.append(corner)
    for a, b, c in ConvexHull(points).simplices.tolist():
        faces.append(coal.Triangle(a, b, c))
    return coal.Convex(corners, faces)


def coal_distance(shapes: list[np.ndarray], T: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Distance, direction from the second to the first, and the point half-way."""
    places = [coal.Transform3s(one[:9].reshape(3, 3).T, one[9:]) for one in T.reshape(-1, ENTRIES)]
    found = coal.DistanceResult()
    request = coal.DistanceRequest()
    request.gjk_tolerance = 1e-9
    distance = coal.distance(
        coal_shape(shapes[0]), places[0], coal_shape(shapes[1]), places[1], request, found
    )
    a, b = np.array(found.getNearestPoint1()), np.array(found.getNearestPoint2())
    return distance, (a - b) / np.linalg.norm(a - b), 0.5 * (a + b)


@pytest.mark.parametrize("shapes", [[SEGMENT, SEGMENT], [SEGMENT, BOX], [BOX, BOX]])
def test_rows_can_be_kept_just_as_far_as_bodies_are_apart(rng, shapes) -> None:
    """Half-way between coal's nearest points lies a plane that keeps them; no other keeps more."""
    for _ in range(20):
        T = random_placements(rng, 2)
        distance, n, middle = coal_distance(shapes, T)
        if distance < 1e-3:  # inside each other: no direction to compare with
            continue
        half = 0.5 * distance
        slot = Slot(Side(0, shapes[0], half), Side(1, shapes[1], half), None)
        rows = plane_rows([slot], 2 * ENTRIES)
        value = np.array(rows.value(T, np.append(n, n @ middle))).ravel()
        assert (value >= rows.lower - 1e-6).all()
        assert (value <= rows.upper + 1e-12).all()
        corners = [
            points @ place[:9].reshape(3, 3) + place[9:]
            for points, place in zip(shapes, T.reshape(-1, ENTRIES), strict=True)
        ]
        for spread in (0.0, 0.01, 0.1, 1.0, 10.0):
            other = n + spread * rng.normal(size=3)
            other /= np.linalg.norm(other)
            kept = (corners[0] @ other).min() - (corners[1] @ other).max()
            assert kept <= distance + 1e-6


def test_a_half_space_keeps_its_own_normal(rng) -> None:
    """Of a body's corners above the surface, which turns with its frame."""
    T = random_placements(rng, 2)
    point = rng.normal(size=3)
    slot = Slot(Side(0, BOX, 0.1), Side(1, point[None], 0.2), NORMAL)
    rows = plane_rows([slot], 2 * ENTRIES)
    R, p = T[ENTRIES : ENTRIES + 9].reshape(3, 3).T, T[ENTRIES + 9 :]
    n, surface = R @ NORMAL, R @ point + p
    d = n @ surface + 0.3
    value = np.array(rows.value(T, np.append(n, d))).ravel()
    corners = BOX @ T[:9].reshape(3, 3) + T[9:ENTRIES]
    np.testing.assert_allclose(value[:8], corners @ n - d, atol=1e-12)
    assert value[8] == pytest.approx(0.3)
    np.testing.assert_allclose(value[9:], 0.0, atol=1e-12)
    np.testing.assert_array_equal(rows.lower, [0.1] * 8 + [0.2] + [0.0] * 3)
    np.testing.assert_array_equal(rows.upper[9:], 0.0)
    other = np.array(rows.value(T, np.append([1.0, 0, 0], d))).ravel()
    np.testing.assert_allclose(other[9:], np.array([1.0, 0, 0]) - n, atol=1e-12)


def three_slots(rng: np.random.Generator) -> PlaneRows:
    slots = [
        Slot(Side(0, SEGMENT, 0.1), Side(2, BOX, 0.2), None),
        Slot(Side(1, rng.normal(size=(1, 3)), 0.1), Side(0, rng.normal(size=(1, 3)), 0.0), NORMAL),
        Slot(Side(2, BOX, 0.1), Side(0, SEGMENT, 0.1), None),  # the same joints once more
    ]
    return plane_rows(slots, 3 * ENTRIES)


def test_slopes_are_differences(rng) -> None:
    rows, h = three_slots(rng), 1e-6
    T, y = random_placements(rng, 3), rng.normal(size=3 * UNKNOWNS)
    by_t, by_y = (np.array(ca.DM(one)) for one in rows.jacobian(T, y))

    def value(T: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.array(rows.value(T, y)).ravel()

    for k, step in enumerate(h * np.eye(T.size)):
        expected = (value(T + step, y) - value(T - step, y)) / (2 * h)
        np.testing.assert_allclose(by_t[:, k], expected, atol=1e-8)
    for k, step in enumerate(h * np.eye(y.size)):
        expected = (value(T, y + step) - value(T, y - step)) / (2 * h)
        np.testing.assert_allclose(by_y[:, k], expected, atol=1e-8)


def test_curvature_is_the_slope_of_the_slopes(rng) -> None:
    rows, h = three_slots(rng), 1e-6
    T, y = random_placements(rng, 3), rng.normal(size=3 * UNKNOWNS)
    m = rng.normal(size=rows.lower.size)
    force, cross, own = (np.array(ca.DM(one)) for one in rows.hessian(T, y, m))

    def pulls(T: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        by_t, by_y = (np.array(ca.DM(one)) for one in rows.jacobian(T, y))
        return by_t.T @ m, by_y.T @ m

    np.testing.assert_allclose(force.ravel(), pulls(T, y)[0], atol=1e-12)
    np.testing.assert_array_equal(own, np.triu(own))
    whole = own + np.triu(own, 1).T
    for k, step in enumerate(h * np.eye(y.size)):
        after, before = pulls(T, y + step), pulls(T, y - step)
        np.testing.assert_allclose(cross[:, k], (after[0] - before[0]) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(whole[:, k], (after[1] - before[1]) / (2 * h), atol=1e-8)
