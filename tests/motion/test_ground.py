"""Margins of many polygons at once against one polygon at a time."""

import numpy as np
import pytest

from wbc.motion.ground import sole_corners, support_margins, touching_corners
from wbc.polygon import convex_hull, polygon_margin
from wbc.robot import Robot
from wbc.robot.series import sole_series


@pytest.mark.parametrize("size", [3, 5, 8, 16])
def test_margins_are_those_of_each_polygon(size: int, rng: np.random.Generator) -> None:
    corners = rng.normal(size=(200, 1, size, 3))
    corners[:50, :, -1] = corners[:50, :, 0]  # corners that are there twice
    if size > 3:
        corners[50:100, :, 1] = 0.5 * (corners[50:100, :, 2] + corners[50:100, :, 3])  # on an edge
    points = rng.normal(size=(200, 2))
    margins = support_margins(corners, np.ones((200, 1, size), dtype=bool), points).margin
    for k in range(200):
        expected = polygon_margin(convex_hull(corners[k, 0, :, :2]), points[k])
        assert margins[k] == pytest.approx(float(expected), abs=1e-12)
    assert (margins > 0.0).any() and (margins < 0.0).any()


def test_gradients_of_the_margin_are_those_of_differences(rng: np.random.Generator) -> None:
    """The margin is a distance: smooth but at kinks, which none of 200 points is near to."""
    corners, points = rng.normal(size=(200, 2, 4, 3)), rng.normal(size=(200, 2))
    touching = rng.random((200, 2, 4)) < 0.7
    touching[:60] &= rng.random((60, 2, 1)) < 0.6  # feet in the air
    found = support_margins(corners, touching, points)
    standing = touching.any(axis=2)
    some = standing.any(axis=1)

    def quotient(moved_corners: np.ndarray, moved_points: np.ndarray) -> np.ndarray:
        ahead = support_margins(corners + moved_corners, touching, points + moved_points).margin
        behind = support_margins(corners - moved_corners, touching, points - moved_points).margin
        return (ahead - behind) / 2e-7

    for k, step in enumerate(1e-7 * np.eye(2, 3)):
        by_point = quotient(np.zeros((2, 1, 3)), step[:2])
        np.testing.assert_allclose(found.gradient[:, k], by_point, atol=1e-6)
        for foot in range(2):
            moved = np.zeros((2, 1, 3))
            moved[foot] = step
            expected = -found.weights[:, foot] * found.gradient[:, k]
            by_foot = quotient(moved, np.zeros(2))
            np.testing.assert_allclose(expected[some], by_foot[some], atol=1e-6)
    assert np.isnan(found.gradient[~some]).all() and not found.weights[~standing].any()


def test_only_standing_feet_count(rng: np.random.Generator) -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    corners = np.tile(np.stack((square, square + [3, 0, 0])), (4, 1, 1, 1))
    standing = np.array([[True, False], [False, True], [True, True], [False, False]])
    points = np.tile([2.0, 0.5], (4, 1))
    touching = np.repeat(standing[..., None], 4, axis=2)
    margins = support_margins(corners, touching, points).margin
    np.testing.assert_allclose(margins[:3], [-1.0, -1.0, 0.5])
    assert np.isnan(margins[3])


def test_collinear_corners_have_no_interior() -> None:
    row = np.array([[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.5, 0.5]]])
    corners = np.tile(np.dstack((row, np.zeros((1, 4))))[:, None], (4, 1, 1, 1))
    points = np.array([[1.0, 1.0], [3.0, 2.0], [0.0, -0.5], [1.6, 0.2]])
    margins = support_margins(corners, np.ones((4, 1, 4), bool), points).margin
    np.testing.assert_allclose(margins, [0.0, -1.0, -0.5, -0.7 * np.sqrt(2.0)], atol=1e-15)


def test_coincident_corners_have_no_interior() -> None:
    corners = np.full((1, 1, 4, 3), 0.5)
    margins = support_margins(corners, np.ones((1, 1, 4), bool), np.array([[3.5, 4.5]])).margin
    np.testing.assert_allclose(margins, [-5.0])


def test_a_sole_that_rolls_touches_with_its_edge_and_one_that_swings_does_not() -> None:
    sole = np.array([[0.1, 0.05, 0], [0.1, -0.05, 0], [-0.1, -0.05, 0], [-0.1, 0.05, 0]])
    time = 0.02 * np.arange(5)
    rolling, swinging = np.tile(sole, (5, 1, 1)), np.tile(sole, (5, 1, 1))
    rolling[:, 2:, 2] += 0.05 * np.arange(5)[:, None]  # heels rise, toes stay
    swinging[:, 2:, 2] += 0.05
    swinging[..., 0] += 2.0 * time[:, None]
    corners = np.stack((rolling, swinging), axis=1)
    expected = np.zeros((5, 2, 4), dtype=bool)
    expected[:, 0, :2] = True
    expected[0, 0] = True  # still flat
    np.testing.assert_array_equal(touching_corners(corners, 0.0, time), expected)


def test_feet_near_ground_are_those_within_1_cm(hoap2: Robot) -> None:
    lifted = hoap2.posture("standing", {"left_hip_pitch": -0.9, "left_knee_pitch": 1.2})
    q = np.stack((hoap2.postures["standing"], lifted))
    corners = sole_corners(hoap2, sole_series(hoap2, q))
    standing = [touching_corners(one[None], 0.0, np.zeros(1)).all(axis=2) for one in corners]
    assert np.concatenate(standing).tolist() == [[True, True], [False, True]]
    assert not touching_corners(corners, 0.5, np.array([0.0, 1.0])).any()
    here = hoap2.snapshot(lifted)
    foot = hoap2.feet["left"]
    flat = np.column_stack((foot.polygon, np.zeros(len(foot.polygon))))
    np.testing.assert_allclose(
        corners[1, 0], flat @ here.rotation(foot.frame).T + here.position(foot.frame), atol=1e-12
    )
