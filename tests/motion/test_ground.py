"""The ground of a motion: margins of many polygons at once, and measured forces."""

from pathlib import Path

import numpy as np
import pytest

import wbc
from wbc.motion import RecordingError, analyze, read_motion
from wbc.motion.forces import WRENCH, MeasuredForces
from wbc.motion.ground import sole_corners, support_margins, touching_corners
from wbc.motion.table import BASE
from wbc.polygon import convex_hull, polygon_margin
from wbc.robot import Robot
from wbc.robot.series import sole_series

ROWS, RATE = 60, 100.0


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


def standing(robot: wbc.Robot) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Times, configurations, and wrenches at the soles' frames: a third on the left foot."""
    q = np.tile(robot.posture("standing"), (ROWS, 1))
    wrenches = {}
    for frame, share in (("left_sole", 1 / 3), ("right_sole", 2 / 3)):
        force = share * robot.weight
        # At a point 1 cm before the frame's origin: moment (r x f) about that origin.
        wrenches[frame] = np.tile([0.0, 0.0, force, 0.0, -0.01 * force, 0.0], (ROWS, 1))
    return np.arange(ROWS) / RATE, q, wrenches


def write(file: Path, robot: wbc.Robot, **changed: np.ndarray) -> Path:
    time, q, wrenches = standing(robot)
    arrays = {"time": time, "q": q, **{f"forces/{k}": w for k, w in wrenches.items()}}
    np.savez(file, **{name: changed.get(name, array) for name, array in arrays.items()})
    return file


def test_measured_cop_is_that_of_the_soles(hoap2: wbc.Robot, tmp_path: Path) -> None:
    series = analyze(read_motion(write(tmp_path / "m.npz", hoap2), hoap2))
    assert series.measured
    here = hoap2.snapshot(hoap2.posture("standing"))
    left, right = here.position("left_sole"), here.position("right_sole")
    wanted = left / 3 + 2 * right / 3 + [0.01, 0.0, 0.0]
    np.testing.assert_allclose(series.cop[:, :2], np.tile(wanted[:2], (ROWS, 1)), atol=1e-9)
    np.testing.assert_allclose(series.ground_force[:, 2], hoap2.weight, rtol=1e-9)
    # A robot at rest needs its weight, which is what was measured.
    np.testing.assert_allclose(series.force_residual, 0.0, atol=1e-6)


def test_forces_of_a_csv_file_are_those_of_the_npz_file(hoap2: wbc.Robot, tmp_path: Path) -> None:
    """Columns as ``wbc sim -o FILE.csv`` names them; without some of them the foot has none."""
    time, q, wrenches = standing(hoap2)
    heads, columns = ["time [s]", *BASE, *hoap2.joint_names], [time[:, None], q]
    for frame, wrench in wrenches.items():
        units = ["N"] * 3 + ["N m"] * 3
        heads += [f"forces/{frame}/{row} [{u}]" for row, u in zip(WRENCH, units, strict=True)]
        columns.append(wrench)
    file = tmp_path / "m.csv"
    np.savetxt(file, np.hstack(columns), delimiter=",", header=",".join(heads), comments="")
    read = read_motion(file, hoap2).forces
    assert read is not None
    for foot, wrench in zip(("left", "right"), wrenches.values(), strict=True):
        np.testing.assert_allclose(read.wrenches[foot], wrench)
    some = read_motion(file, hoap2, ignore=["forces/left_sole/fz*"]).forces
    assert some is not None and list(some.wrenches) == ["right"]


def test_foot_in_the_air_has_no_force(hoap2: wbc.Robot, tmp_path: Path) -> None:
    file = write(tmp_path / "m.npz", hoap2, **{"forces/left_sole": np.zeros((ROWS, 6))})
    series = analyze(read_motion(file, hoap2), cutoff=None)
    right = hoap2.snapshot(hoap2.posture("standing")).position("right_sole")
    np.testing.assert_allclose(series.cop[:, :2], np.tile(right[:2] + [0.01, 0.0], (ROWS, 1)))
    np.testing.assert_allclose(series.force_residual[:, 2], -hoap2.weight / 3, rtol=1e-9)


@pytest.mark.parametrize("wrong", [np.zeros((ROWS, 3)), np.full((ROWS, 6), np.nan)])
def test_impossible_forces_are_refused(hoap2: wbc.Robot, tmp_path: Path, wrong: np.ndarray) -> None:
    file = write(tmp_path / "m.npz", hoap2, **{"forces/left_sole": wrong})
    with pytest.raises(RecordingError, match=r"m\.npz: measured forces, left"):
        read_motion(file, hoap2)


def test_force_times_and_rows_must_agree() -> None:
    with pytest.raises(wbc.WbcError, match="left"):
        MeasuredForces(np.arange(3.0), {"left": np.zeros((4, 6))})
