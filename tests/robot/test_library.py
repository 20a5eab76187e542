"""Named robots: found without their package's loaders, and standing as they should.

The oracle for sizes and masses is the URDF's XML, read here with ElementTree.
"""

import importlib.metadata
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.standing import sole_corners
from wbc.errors import ModelError, UnknownNameError
from wbc.polygon import convex_hull, polygon_margin
from wbc.robot import Robot, robot_names
from wbc.robot.library import DATA_VARIABLE, ROBOTS, find_robot

Load = Callable[[str], Robot]
MASSES = {"hoap2_like": 7.1, "g1": 33.3, "g1_27": 33.3, "talos": 90.3, "icub": 28.3, "romeo": 40.5}
VELOCITIES = {"hoap2_like": 31, "g1": 35, "g1_27": 33, "talos": 36, "icub": 38, "romeo": 37}


def test_every_named_robot_is_checked_here() -> None:
    assert set(robot_names()) == set(MASSES) == set(VELOCITIES)


@pytest.mark.parametrize("name", robot_names())
def test_sizes_and_mass_are_those_of_the_file(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    root = ET.parse(robot.path).getroot()
    kinds = [joint.get("type") for joint in root.findall("joint")]
    moving = sum(kind in {"revolute", "prismatic", "continuous"} for kind in kinds)
    masses = [float(mass.get("value", "nan")) for mass in root.findall("link/inertial/mass")]
    assert robot.name == name
    assert robot.nv == 6 + moving - len(ROBOTS[name].locked) == VELOCITIES[name]
    assert robot.nq == robot.nv + 1
    assert robot.mass == pytest.approx(sum(masses), rel=1e-12)  # rounding of two sums
    assert robot.mass == pytest.approx(MASSES[name], abs=0.05)


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_has_all_limits_and_both_feet(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    assert robot.limits.missing == ()
    assert list(robot.feet) == ["left", "right"]
    s = robot.snapshot(robot.posture())
    left, right = (s.position(robot.feet[side].frame) for side in robot.feet)
    assert left[1] > 0.03 and right[1] < -0.03  # m: faces +x, feet apart
    forward = s.rotation(robot.feet["left"].frame)[:, 0]
    assert forward[0] > 0.99


@pytest.mark.parametrize("name", robot_names())
def test_standing_is_flat_on_the_ground_balanced_and_within_limits(name: str, robot_named) -> None:
    robot = robot_named(name)
    s = robot.snapshot(robot.posture("standing"))
    corners = sole_corners(s)
    # m; iCub's file rounds the turns of its frames to 5 digits, Romeo's posture has 7
    np.testing.assert_allclose(corners[:, 2], 0.0, atol=2e-5 if name == "icub" else 1e-7)
    assert polygon_margin(convex_hull(corners[:, :2]), s.com[:2]) > 0.03  # m
    assert (robot.limits.past(s.joint_positions) <= 0.0).all()


@pytest.mark.parametrize("name", robot_names())
def test_standing_bends_both_knees_alike(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    q = robot.limits.joint_positions(robot.posture("standing"))
    knees = [k for k, n in enumerate(robot.joint_names) if "knee" in n.lower() or "_4_" in n]
    knees = [k for k in knees if "arm" not in robot.joint_names[k]]
    assert len(knees) == 2
    assert abs(q[knees[0]]) > 0.3
    assert q[knees[0]] == pytest.approx(q[knees[1]])


def test_notes_say_what_is_odd_in_the_files(robot_named: Load) -> None:
    told = robot_named("icub").notes
    assert any("taken as points" in note and "r_hip_1" in note for note in told)
    assert any("90 degrees" in note for note in told)
    (note,) = robot_named("romeo").notes
    assert "RShoulderYawLink, RElbowYawLink" in note  # izz ten times smaller than on the left
    for name in ("hoap2_like", "g1", "g1_27", "talos"):
        assert robot_named(name).notes == ()


def test_loading_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    for name in robot_names():
        Robot.load(name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["talos", "icub", "romeo"])
def test_half_sitting_is_read_from_the_srdf(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    states = ET.parse(robot.srdf).findall("group_state[@name='half_sitting']/joint")
    read = {joint.get("name"): joint.get("value", "") for joint in states}
    q = robot.limits.joint_positions(robot.postures["half_sitting"])
    found = dict(zip(robot.joint_names, q.tolist(), strict=True))
    known = [joint for joint in found if joint in read]
    assert len(known) > 25
    for joint in known:
        assert found[joint] == pytest.approx(float(read[joint]), abs=1e-6)  # digits of the limits


def test_the_waist_of_g1_27_is_bolted(g1: Robot, g1_27: Robot) -> None:
    bolted = set(g1.joint_names) - set(g1_27.joint_names)
    assert bolted == {"waist_roll_joint", "waist_pitch_joint"}
    same = g1_27.snapshot(g1_27.posture()), g1.snapshot(g1.posture())
    np.testing.assert_allclose(same[0].com, same[1].com, atol=1e-12)
    np.testing.assert_allclose(same[0].inertia, same[1].inertia, atol=1e-12)


def test_an_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean 'talos'.*the path of a URDF or MJCF"):
        Robot.load("tallos")


def test_a_missing_package_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_: str) -> None:
        raise importlib.metadata.PackageNotFoundError

    monkeypatch.setattr(importlib.metadata, "files", missing)
    monkeypatch.setattr(sys, "path", [])
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    with pytest.raises(ModelError, match=r"pip install wbc\[robots\]"):
        find_robot("g1")
    assert find_robot("hoap2_like").path.is_file()


def test_the_data_may_be_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / ROBOTS["g1"].urdf
    file.parent.mkdir(parents=True)
    file.write_text("<robot/>")
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    assert find_robot("g1").path == file
    assert find_robot("talos").path.is_file()  # not there, but installed
