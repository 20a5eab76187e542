"""`wbc analyze` of a human's recording as a user meets it."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import Result

from tests.command import wbc_command
from tests.human.walker import recorded, write_trc
from wbc.human.body import HumanBody

BODY = HumanBody.of(1.76, 72.0, "male")


def command(*arguments: object) -> Result:
    return wbc_command("analyze", *arguments)


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
    answer = command(
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
        answer = command(*arguments)
        assert answer.exit_code != 0 and words in " ".join(answer.stderr.split()), answer.stderr
