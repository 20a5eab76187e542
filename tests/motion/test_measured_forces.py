"""Recordings with measured forces: the ground is what the soles measured."""

from pathlib import Path

import numpy as np
import pytest

import wbc
from wbc.motion import RecordingError, analyze, read_motion
from wbc.motion.forces import WRENCH, MeasuredForces
from wbc.motion.table import BASE

ROWS, RATE = 60, 100.0


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
