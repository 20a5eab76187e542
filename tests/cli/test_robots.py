"""What a robot is described by: everything that a problem can name or must respect."""

from pathlib import Path

import pytest

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
    inertial = (
        '<inertial><mass value="1"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
    )
    path.write_text(
        f'<robot name="arm"><link name="arm_link0">{inertial}</link>'
        f'<link name="upper">{inertial}</link><joint name="j" type="revolute">'
        '<parent link="arm_link0"/><child link="upper"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="0" velocity="0"/></joint></robot>'
    )
    answer = wbc_command("robots", path)
    assert "missing limits: velocity (j); effort (j)" in answer.stdout
    assert "note: arm: joints without a limit: velocity (j); effort (j)" in answer.stderr
    row = next(line for line in answer.stdout.splitlines() if line.startswith("j "))
    assert row.split() == ["j", "-1", "1", "none", "none", "1.000"]


def test_joints_that_follow_others_are_named(tmp_path: Path) -> None:
    inertial = (
        '<inertial><mass value="1"/>'
        '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
    )
    joint = (
        '<joint name="{0}" type="revolute"><parent link="palm"/><child link="{0}_link"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>{1}</joint>'
    )
    mimic = '<mimic joint="thumb" multiplier="-0.5" offset="0.1"/>'
    links = "".join(
        f'<link name="{name}">{inertial}</link>' for name in ("palm", "thumb_link", "finger_link")
    )
    path = tmp_path / "hand.urdf"
    joints = joint.format("thumb", "") + joint.format("finger", mimic)
    path.write_text(f'<robot name="hand">{links}{joints}</robot>')
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
