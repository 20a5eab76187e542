"""What a robot is described by: everything that a problem can name or must respect."""

from pathlib import Path

import pytest

from tests import urdf
from tests.command import wbc_command
from wbc.robot import Robot


def test_joints_have_limits_and_masses_and_the_masses_add_up(hoap2: Robot) -> None:
    text = wbc_command("robots", "hoap2_like").stdout
    table, _, _ = text.partition("missing limits")
    rows = {line.split()[0]: line.split()[1:] for line in table.splitlines() if line.strip()}
    elbow = hoap2.joint_names.index("left_elbow_pitch")
    limits = hoap2.limits
    shown = [limits.lower[elbow], limits.upper[elbow], limits.velocity[elbow], limits.effort[elbow]]
    assert [float(cell) for cell in rows["left_elbow_pitch"][:4]] == pytest.approx(shown, rel=1e-3)
    masses = [float(rows[name][-1]) for name in ("base", *hoap2.joint_names)]
    assert sum(masses) == pytest.approx(hoap2.mass, abs=5e-4 * len(masses))  # printed to 1 g
    assert "missing limits: none" in text
    assert set(hoap2.frame_names) <= set(text.split())


def test_missing_limits_are_said(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(urdf.arm_of_one_joint(urdf.limit(1, 0, 0)))
    answer = wbc_command("robots", path)
    assert "missing limits: velocity (j); effort (j)" in answer.stdout
    assert "note: arm: joints without a limit: velocity (j); effort (j)" in answer.stderr
    row = next(line for line in answer.stdout.splitlines() if line.startswith("j "))
    assert row.split() == ["j", "-1", "1", "none", "none", "1.000"]


def test_names_that_look_like_markup_are_printed_as_they_are(tmp_path: Path) -> None:
    """A console would take [/j] for the end of a style, and leave [lr] out."""
    links = map(urdf.link, ("base", "[lr]eft"))
    text = urdf.robot("odd", *links, urdf.joint("[/j]", "base", "[lr]eft"))
    (tmp_path / "[odd].urdf").write_text(text)
    shown = wbc_command("robots", tmp_path / "[odd].urdf").stdout
    assert {"[lr]eft", "[/j]"} <= set(shown.partition("frames:")[2].split())
    problem = tmp_path / "[p].yaml"
    problem.write_text(
        "robot: '[odd].urdf'\ntasks:\n  p: {type: posture, target: start}\n"
        "  tip: {type: frame, frame: '[lr]eft', control: position, target: start}\n"
        "stop: {duration: 0.05}\n"
    )
    assert "([/j], tick 0)" in wbc_command("run", problem).stdout


def test_joints_that_follow_others_are_named(tmp_path: Path) -> None:
    path = tmp_path / "hand.urdf"
    links = map(urdf.link, ("palm", "thumb_link", "finger_link"))
    mimic = '<mimic joint="thumb" multiplier="-0.5" offset="0.1"/>'
    thumb = urdf.joint("thumb", "palm", "thumb_link")
    finger = urdf.joint("finger", "palm", "finger_link", mimic)
    path.write_text(urdf.robot("hand", *links, thumb, finger))
    assert "finger follows: -0.5 thumb +0.1\n" in wbc_command("robots", path).stdout


def test_tab_offers_what_begins_so() -> None:
    from wbc.cli.options import (
        directions_beginning,
        layers_beginning,
        robots_beginning,
        solvers_beginning,
    )

    assert "g1" in robots_beginning("g") and "talos" not in robots_beginning("g")
    assert solvers_beginning("act") == ["active_set"]
    assert directions_beginning("front-r") == ["front-right"]
    assert layers_beginning("ground,ell") == ["ground,ellipsoid"]
    assert "no-ground" in layers_beginning("no-") and "robot" not in layers_beginning("no-")
