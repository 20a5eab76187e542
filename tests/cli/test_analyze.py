"""`wbc analyze` as a user meets it, of robots and of humans."""

import inspect
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import Result

import wbc.cli.analyze as command_module
from tests.command import wbc_command
from tests.human.walker import recorded, write_trc
from wbc.cli import progress
from wbc.cli.analyze_report import verdict
from wbc.cli.sim_report import _cop
from wbc.human.body import HumanBody
from wbc.motion import Motion, read_motion
from wbc.motion import analyze as series_of
from wbc.robot import Robot

TIME = np.arange(100) / 100.0
BODY = HumanBody.of(1.76, 72.0, "male")


@pytest.fixture
def walk(hoap2: Robot, tmp_path: Path) -> Path:
    joints = np.tile(hoap2.limits.joint_positions(hoap2.postures["standing"]), (100, 1))
    for pattern, size in (("*_hip_pitch", -0.2), ("*_knee_pitch", 0.4), ("*_ankle_pitch", -0.2)):
        for k in hoap2.joint_indices(pattern):
            joints[:, k - 6] += size * np.sin(4.0 * TIME) ** 2
    path = tmp_path / "walk.csv"
    header = ",".join(("time", *hoap2.joint_names))
    np.savetxt(path, np.column_stack((TIME, joints)), delimiter=",", header=header, comments="")
    return path


def command(*arguments: object) -> Result:
    return wbc_command("analyze", *arguments, "--robot", "hoap2_like")


def test_a_good_run(walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", np.inf)  # however busy the machine is
    outputs = [tmp_path / "r.npz", tmp_path / "r.csv"]
    options = [part for path in outputs for part in ("--output", path)]
    answer = command(walk, "--planted", "auto", "--cutoff", "8", "--resample", "50", *options)
    assert answer.exit_code == 0, answer.stderr
    for words in ("walk.csv", "50 frames", "50 Hz", "CoP inside the support", "radius r1", "r.csv"):
        assert words in answer.stdout
    assert answer.stderr == ""
    with np.load(outputs[0]) as file:
        assert file["time"].shape == (50,)
    assert len(outputs[1].read_text().splitlines()) == 51


@pytest.mark.slow
def test_a_picture(walk: Path, tmp_path: Path) -> None:
    answer = command(
        walk, "--planted", "left", "--plot", tmp_path / "p.png", "--snapshots", 2, "--quiet"
    )
    assert (answer.exit_code, answer.stdout) == (0, "")
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")


def test_dropouts_are_printed(walk: Path) -> None:
    lines = walk.read_text().splitlines()
    walk.write_text("\n".join(lines[:40] + lines[43:]))
    answer = command(walk, "--planted", "left", "--cutoff", "none")
    assert answer.exit_code == 0
    assert "gap in time from 0.38 s to 0.42 s" in answer.stdout


def test_what_is_missing_is_filled_by_the_option_that_the_error_names(walk: Path) -> None:
    header, *rows = walk.read_text().splitlines()
    cells = rows[40].split(",")
    walk.write_text("\n".join([header, *rows[:40], ",".join([*cells[:-1], "nan"]), *rows[41:]]))
    options = ["--planted", "left", "--cutoff", "none"]
    answer = command(walk, *options)
    assert (answer.exit_code, answer.stdout) == (1, "")
    column = header.rpartition(",")[2]
    assert f"column {column!r}, row 41 (line 42): NaN or an empty cell" in answer.stderr
    assert "have it interpolated (fill=True, --fill)" in answer.stderr
    answer = command(walk, *options, "--fill")
    assert answer.exit_code == 0, answer.stderr
    assert "interpolated" in answer.stdout


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "planted"),
        (["--planted", "middle"], "middle"),
        (["--planted", "left", "--cutoff", "fast"], "--cutoff"),
        (["--planted", "left", "--cutoff", "60"], "half the recording"),
        (["--planted", "left", "--feet", ","], "feet"),
        (["--planted", "left", "--rate", "100"], "rate"),
        (["--planted", "left", "-o", "no/folder/r.npz"], "no folder"),
        (["--planted", "left", "-o", "r.json"], ".npz"),
        (["--planted", "left", "--plot", "r.gif"], "gif"),
        (["--planted", "left", "--plot", "r.png", "--snapshots", "0"], "snapshots"),
        (["--planted", "left", "--plot", "r.png", "--snapshots", "0,x"], "snapshots"),
        (["--planted", "left", "--resample", "0.5"], "one frame"),
    ],
)
def test_bad_input_is_one_line(walk: Path, options: list[str], words: str) -> None:
    answer = command(walk, *options)
    assert (answer.exit_code, answer.stdout) == (1, "")
    assert answer.stderr.startswith("error: ") and words in answer.stderr
    assert answer.stderr.count("\n") == 1


def test_the_recording_is_not_overwritten(walk: Path) -> None:
    before = walk.read_bytes()
    answer = command(walk, "--planted", "left", "-o", walk)
    assert answer.exit_code == 1 and "is the recording itself" in answer.stderr
    assert walk.read_bytes() == before


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "CoP inside the support polygon wherever"),
        (["--ground", "-0.3"], "CoP not checked: no sole ever touches the ground"),
        (["--feet", "none"], "CoP not checked: no feet"),
        (["--feet", "left", "--ground", "0"], "CoP outside the support polygon in 100 of 100"),
    ],
)
def test_what_is_said_of_the_cop(hoap2, tmp_path, options, words) -> None:
    q = np.tile(hoap2.postures["standing"], (100, 1))
    waist = hoap2.joint_names.index("waist_pitch")
    q[:, 7 + waist] = hoap2.limits.upper[waist] + 0.05
    np.savez(tmp_path / "still.npz", time=TIME, q=q)
    answer = command(tmp_path / "still.npz", *options)
    assert answer.exit_code == 0, answer.stderr
    said = " ".join(answer.stdout.split())
    assert words in said
    assert "waist_pitch is up to 0.05 past its limits" in said
    assert ("wherever there is one" in said) == (not options)


def test_defaults_are_those_of_the_library() -> None:
    reading = inspect.signature(read_motion).parameters
    analysis = inspect.signature(series_of).parameters
    assert float(command_module.CUTOFF) == analysis["cutoff"].default
    assert analysis["feet"].default == command_module.FEET
    assert reading["longest_gap"].default == command_module.LONGEST_GAP
    assert reading["beyond"].default == command_module.BEYOND


@pytest.mark.parametrize(
    ("measured", "words"),
    [
        (False, "the motion is infeasible there"),
        (True, "it was measured, so check with --cutoff none"),
    ],
)
def test_what_was_measured_was_feasible(hoap2: Robot, measured: bool, words: str) -> None:
    """A filter that blurs a landing takes the CoP outside the soles."""
    q = np.tile(hoap2.postures["standing"], (100, 1))
    one_foot = series_of(Motion(hoap2, TIME, q[:, 7:], q[:, :7]), feet=["left"])
    said = str(verdict(replace(one_foot, measured=measured)))
    assert words in said
    assert "--cutoff" not in str(verdict(replace(one_foot, measured=measured, cutoff=None)))
    assert " mm at most, first at 0 s" in said


def test_what_the_filter_extrapolates_at_the_ends_is_told_apart(hoap2: Robot) -> None:
    """A walk that begins in the middle of a step was said to be infeasible by 1.1 m at 0 s."""
    q = np.tile(hoap2.postures["standing"], (100, 1))
    series = series_of(Motion(hoap2, TIME, q[:, 7:], q[:, :7]))
    assert series.cop_margin is not None
    margin = series.cop_margin.copy()
    margin[0] = -1.1
    at_the_end = str(verdict(replace(series, cop_margin=margin, uncertainty=None)))
    assert "at 0 s: only within a period of the low-pass of an end" in at_the_end
    margin = margin.copy()
    margin[50] = -0.03
    elsewhere = str(verdict(replace(series, cop_margin=margin, uncertainty=None)))
    assert "the motion is infeasible there" in elsewhere
    # The soles' forces of a simulation are 0 in its first row.
    flight = np.arange(100) == 0
    said = str(verdict(replace(series, flight=flight)))
    assert "does not push in 1 of 100 frames, only within a period of the low-pass" in said
    said = str(verdict(replace(series, flight=flight | (np.arange(100) == 50))))
    assert "does not push in 2 of 100 frames" in said and "extrapolates" not in said
    assert "extrapolates the motion; elsewhere 30 mm at most" in elsewhere


@pytest.mark.parametrize(
    ("margin", "words"),
    [
        (-1e-9, "at least 0.0 mm inside the soles"),
        (2e-3, "at least 2.0 mm inside the soles"),
        (-1.6e-3, "at most 1.6 mm outside the soles"),
    ],
)
def test_where_the_cop_of_a_simulation_was(margin: float, words: str) -> None:
    assert words in _cop(SimpleNamespace(least_cop_margin=margin, cop_error=0.0))
    unwanted = _cop(SimpleNamespace(least_cop_margin=margin, cop_error=np.nan))  # it fell on them
    assert words in unwanted and "nan" not in unwanted


def noisy_standing(path: Path) -> None:
    """Write a HOAP-2 at rest as encoders without a base see it: joints with 3e-3 rad of noise."""
    robot = Robot.load("hoap2_like")
    joints = np.tile(robot.limits.joint_positions(robot.postures["standing"]), (400, 1))
    joints += 3e-3 * np.random.default_rng(2).normal(size=joints.shape)
    time = np.arange(400) / 200.0
    np.savez(path, time=time, names=np.array(robot.joint_names), positions=joints)


def test_what_is_said_of_noise(tmp_path: Path) -> None:
    noisy_standing(tmp_path / "still.npz")
    options = [tmp_path / "still.npz", "--planted", "left", "--feet", "left,right"]
    said = " ".join(command(*options).stdout.split())
    assert "mrad of joints (standard deviation, median); low-pass at 10 Hz" in said
    assert "not distinguishable from the recording's noise" in said
    assert "feasibility is undecided" in said and "infeasible" not in said
    assert "95 % band" in said and "±" in said
    unasked = " ".join(command(*options, "--noise", "none").stdout.split())
    assert "the motion is infeasible there" in unasked and "±" not in unasked
    chosen = " ".join(command(*options, "--cutoff", "residual").stdout.split())
    assert "CoP inside the support polygon wherever there is one." in chosen


def test_what_is_infeasible_beyond_the_noise_is_said_to_be(tmp_path: Path) -> None:
    noisy_standing(tmp_path / "still.npz")
    options = [tmp_path / "still.npz", "--planted", "left", "--feet", "left", "--cutoff", "1"]
    said = " ".join(command(*options).stdout.split())
    assert "beyond the noise, first at 0 s: the motion is infeasible there" in said


def write_mot(path: Path, seconds: float) -> None:
    """Write the march's plate, y up."""
    plate = recorded(BODY, seconds=seconds, plates=True)[0].plates[0]
    turn = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)))
    force = plate.force @ turn.T
    cop = np.column_stack((-plate.moment[:, 1], plate.moment[:, 0])) / plate.force[:, 2:]
    point = np.column_stack((cop[:, 0], np.zeros(len(cop)), -cop[:, 1]))
    free = plate.moment @ turn.T - np.cross(point, force)
    names = [f"f_force_{kind}{axis}" for kind in "vp" for axis in "xyz"]
    names += [f"f_torque_{axis}" for axis in "xyz"]
    rows = np.column_stack((plate.time, force, point, free))
    text = "\n".join(" ".join(f"{v:.9g}" for v in row) for row in rows)
    path.write_text("f\nendheader\n" + " ".join(["time", *names]) + "\n" + text + "\n")


@pytest.mark.slow
def test_a_march_beside_its_plate(tmp_path: Path) -> None:
    write_trc(tmp_path / "march.trc", recorded(BODY, seconds=3.0)[0])
    write_mot(tmp_path / "march.mot", 3.0)
    answer = wbc_command("analyze",
        tmp_path / "march.trc", "--forces", tmp_path / "march.mot", "--static",
        tmp_path / "march.trc", "--output", tmp_path / "march.npz", "--plot",
        tmp_path / "march.png", "--snapshots", 3,
    )  # fmt: skip
    assert answer.exit_code == 0, answer.stderr
    for words in ("human", "markers", "y taken for up", "push of the ground", "march.npz"):
        assert words in answer.stdout, words
    assert (tmp_path / "march.png").stat().st_size > 10_000
    with np.load(tmp_path / "march.npz") as file:
        assert file["q"].shape == (300, 41)


def test_whose_motion_it_is_must_be_said(tmp_path: Path) -> None:
    robots, humans = tmp_path / "r.csv", tmp_path / "h.trc"
    robots.write_text("time,a\n0,0\n")
    humans.write_text("PathFileType\n")
    for arguments, words in (
        ((robots,), "name the robot that moves: --robot"),
        ((humans, "--robot", "g1"), "leave --robot out"),
        ((robots, "--robot", "g1", "--mass", 70), "--mass: only of a human's recording"),
        ((humans,), "does not begin as a TRC file"),
        ((humans, "--degrees", "--rate", 50), "--rate, --degrees: only of a robot's recording"),
        ((humans, "--unit", "m"), "unit: only for .bvh; a .trc names its unit"),
        ((tmp_path / "none.c3d",), "cannot be read"),
    ):
        answer = wbc_command("analyze", *arguments)
        assert answer.exit_code != 0 and words in " ".join(answer.stderr.split()), answer.stderr
