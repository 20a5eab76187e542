"""CoP, CMP and support polygon against sums of corner forces, definitions and brute force."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.polygon import polygon_margin
from wbc.rmp.ground import (
    FLIGHT,
    centre_of_pressure,
    centroidal_moment_pivot,
    in_contact,
    normal_moment,
    total_wrench,
)


def pushes(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """CoMs above the ground and forces that push (count, 3) each."""
    com = rng.normal(size=(count, 3)) + (0.0, 0.0, 5.0)
    force = 50.0 * rng.normal(size=(count, 3))
    force[:, 2] = rng.uniform(100.0, 500.0, count)
    return com, force


def test_cop_of_corner_forces_is_their_weighted_mean(rng: np.random.Generator) -> None:
    for height in (0.0, -1.3):
        corners = rng.normal(size=(8, 3))
        corners[:, 2] = height
        forces = rng.normal(size=(8, 3))
        forces[:, 2] = rng.uniform(1.0, 100.0, 8)
        com = np.array([0.1, -0.2, 0.9])
        wrenches = [(p, np.append(f, np.zeros(3))) for p, f in zip(corners, forces, strict=True)]
        force, moment = total_wrench(wrenches, com)
        found = centre_of_pressure(com, force, moment, height)
        expected = forces[:, 2] @ corners / forces[:, 2].sum()
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)
        np.testing.assert_allclose(force, forces.sum(axis=0), rtol=1e-14)


def test_a_wrench_given_at_another_point_is_the_same_wrench(rng: np.random.Generator) -> None:
    p, shift, com = rng.normal(size=(3, 3))
    f, m = rng.normal(size=(2, 3))
    here = total_wrench([(p, np.append(f, m))], com)
    there = total_wrench([(p + shift, np.append(f, m - np.cross(shift, f)))], com)
    for a, b in zip(here, there, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-14)


@pytest.mark.parametrize("height", [0.0, 0.4])
def test_cop_and_moment_that_made_the_push_are_found(rng, height: float) -> None:
    """Paper 8.1 forwards: k'_c = (p - c) x f_r + m_r with m_r along the normal."""
    com, force = pushes(rng, 30)
    cop = np.column_stack((rng.normal(size=(30, 2)), np.full(30, height)))
    about_normal = rng.normal(size=30)
    moment = np.cross(cop - com, force) + about_normal[:, None] * (0.0, 0.0, 1.0)
    found = centre_of_pressure(com, force, moment, height)
    np.testing.assert_allclose(found, cop, rtol=0, atol=1e-12)
    # Sums of products of 5 m and 500 N: 1e-11.
    left = normal_moment(com, force, moment, found)
    np.testing.assert_allclose(left, about_normal, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(found[3], centre_of_pressure(com[3], force[3], moment[3], height))


def test_cmp_is_on_the_ground_and_on_the_line_of_force(rng: np.random.Generator) -> None:
    com, force = pushes(rng, 30)
    found = centroidal_moment_pivot(com, force, 0.3)
    np.testing.assert_allclose(found[:, 2], 0.3)
    np.testing.assert_allclose(np.cross(found - com, force), 0.0, rtol=0, atol=1e-10)
    # Without a change of angular momentum CoP and CMP are one point; else n x k' parts them.
    at_rest = centre_of_pressure(com, force, np.zeros_like(com), 0.3)
    np.testing.assert_allclose(at_rest, found, rtol=0, atol=1e-13)
    moment = rng.normal(size=(30, 3))
    apart = found - centre_of_pressure(com, force, moment, 0.3)
    expected = -np.cross((0.0, 0.0, 1.0), moment) / force[:, 2:]
    np.testing.assert_allclose(apart, expected, rtol=0, atol=1e-12)


def test_there_is_no_cop_without_a_push() -> None:
    com, force = np.array([[0.0, 0.0, 1.0]] * 2), np.array([[0.0, 0.0, 5.0], [1.0, 0.0, 0.0]])
    with pytest.raises(InvalidInputError, match="does not push up"):
        centre_of_pressure(com, force, np.zeros((2, 3)))
    with pytest.raises(InvalidInputError, match="does not push up"):
        centroidal_moment_pivot(com[0], -force[0])
    weight = 9.81 * 20.0
    up = np.array([-1.0, 0.0, 0.99 * FLIGHT, 1.01 * FLIGHT, 1.0]) * weight
    forces = np.stack((up * 0.0, up * 0.0, up), axis=1)
    assert in_contact(forces, weight).tolist() == [False, False, False, True, True]


def test_margin_against_a_finely_sampled_rim(rng: np.random.Generator) -> None:
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 7))
    corners = np.stack((3.0 * np.cos(angles), np.sin(angles)), axis=1)  # on an ellipse: convex
    steps = np.linspace(0.0, 1.0, 2001)[:, None]
    following = np.roll(corners, -1, axis=0)
    rim = np.concatenate([a + steps * (b - a) for a, b in zip(corners, following, strict=True)])
    points = rng.uniform(-4.0, 4.0, size=(5, 40, 2))
    found = polygon_margin(corners, points)
    distance = np.linalg.norm(points[:, :, None] - rim, axis=-1).min(axis=-1)
    # Edges are at most 6 m long, so samples are 3 mm apart.
    np.testing.assert_allclose(np.abs(found), distance, rtol=0, atol=2e-3)
    # The winding number tells inside from outside.
    spokes = corners - points[:, :, None]
    bearings = np.arctan2(spokes[..., 1], spokes[..., 0])
    turns = np.diff(np.concatenate((bearings, bearings[..., :1]), axis=-1), axis=-1)
    winding = ((turns + np.pi) % (2.0 * np.pi) - np.pi).sum(axis=-1)
    np.testing.assert_array_equal(found > 0.0, winding > np.pi)
    assert 0 < (found > 0.0).sum() < found.size


def test_points_and_segments_have_no_inside() -> None:
    assert float(polygon_margin([[1.0, 1.0]], [4.0, 5.0])) == pytest.approx(-5.0)
    segment = [[0.0, 0.0], [2.0, 0.0]]
    np.testing.assert_allclose(
        polygon_margin(segment, [[1.0, 0.0], [1.0, 0.5], [5.0, 4.0]]), [0.0, -0.5, -5.0]
    )


@pytest.mark.parametrize(
    ("polygon", "message"),
    [
        ([], "needs corners"),
        ([[0, 2], [2, 2], [2, 0], [0, 0]], "convex"),
        ([[0, 0], [2, 0], [0.5, 0.5], [0, 2]], "convex"),
        ([[np.cos(a), np.sin(a)] for a in 0.8 * np.pi * np.arange(5)], "convex"),  # a star
        ([[0, 0], [np.nan, 0], [1, 1]], "NaN"),
        ([[0, 0, 0]], "expected shape"),
    ],
)
def test_bad_polygons_are_refused(polygon: list[list[float]], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        polygon_margin(polygon, [0.0, 0.0])


@pytest.mark.parametrize(
    ("wrenches", "message"),
    [
        ([np.zeros(6)], r"wrenches\[0\]: expected a pair"),
        ([3.0], r"wrenches\[0\]: expected a pair"),
        ([(np.zeros(3), np.zeros(6)), (np.zeros(2), np.zeros(6))], r"wrenches\[1\], position"),
        ([(np.zeros(3), np.zeros(3))], r"wrenches\[0\], wrench: expected shape \(6,\)"),
        ([(np.zeros(3), [0, 0, np.inf, 0, 0, 0])], r"NaN or infinite"),
    ],
)
def test_bad_wrenches_are_named(wrenches: list[object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        total_wrench(wrenches, np.zeros(3))  # type: ignore[arg-type]
