"""Drives and limits of joints: read, given, against the URDF's XML, and where dynamics has them."""

import pickle
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import wbc
from tests import urdf
from tests.robot.formats.mjcf_texts import assert_agree, mujoco
from wbc.cli.errors import missing_limits
from wbc.errors import InvalidInputError, ModelError, UnknownNameError, WbcError
from wbc.robot import JointLimits, Robot

LIGHT = '<inertial pos="0 0 -.1" mass="1" diaginertia=".1 .1 .1"/>'
MJCF = f"""
<mujoco model="leg"><compiler angle="radian"/>
  <default><joint armature="0.02" damping="0.3" frictionloss="0.05"/>
    <default class="strong"><joint armature="0.07" actuatorfrcrange="-11 11"/></default></default>
  <worldbody><body name="trunk"><freejoint/>
    <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>
    <body name="thigh"><joint name="hip" axis="0 1 0" range="-1 1"/>{LIGHT}
      <body name="shank" pos="0 0 -.3">
        <joint name="knee" class="strong" axis="0 1 0" range="-1 1" damping="0.9"/>{LIGHT}
        <body name="foot" pos="0 0 -.3"><joint name="ankle" axis="0 1 0" range="-1 1"/>{LIGHT}
  </body></body></body></body></worldbody></mujoco>
"""


@pytest.fixture
def leg(tmp_path: Path) -> Path:
    path = tmp_path / "leg.xml"
    path.write_text(MJCF)
    return path


def test_what_an_mjcf_says_is_kept(leg: Path) -> None:
    """Oracle: MuJoCo's own compiler, and its mass matrix."""
    robot = Robot.load(leg)
    np.testing.assert_array_equal(robot.limits.effort, [np.inf, 11.0, np.inf])
    model = mujoco.MjModel.from_xml_path(str(leg))
    for ours, theirs in (
        (robot.armature, model.dof_armature),
        (robot.damping, model.dof_damping),
        (robot.friction, model.dof_frictionloss),
    ):
        np.testing.assert_array_equal(ours, theirs[6:])
    assert_agree(robot, model)


def test_what_a_urdf_says_is_kept(robot_named) -> None:
    """Oracle: the file itself, read by the standard library."""
    robot = robot_named("talos")
    dynamics = {
        joint.get("name"): joint.find("dynamics").attrib
        for joint in ET.parse(robot.path).getroot().findall("joint")
        if joint.find("dynamics") is not None
    }
    for key, values in (("damping", robot.damping), ("friction", robot.friction)):
        expected = [float(dynamics.get(name, {}).get(key, 0)) for name in robot.joint_names]
        np.testing.assert_array_equal(values, expected)
        assert values.any()


def test_rotor_inertia_is_in_the_mass_matrix_once_and_in_inverse_dynamics(g1_27, rng) -> None:
    robot = Robot.load("g1_27", armature={"*": 0.02, "*_knee_*": 0.5})
    expected = np.where(["knee" in name for name in robot.joint_names], 0.5, 0.02)
    np.testing.assert_array_equal(robot.armature, expected)
    q, a = robot.posture("standing"), rng.normal(size=robot.nv)
    before, here = g1_27.snapshot(q), robot.snapshot(q)
    added = here.mass_matrix - before.mass_matrix
    np.testing.assert_allclose(added, np.diag(np.r_[np.zeros(6), expected]), atol=1e-12)
    torque = pin.rnea(robot.model, robot.model.createData(), q, np.zeros(robot.nv), a)
    np.testing.assert_allclose(torque, here.mass_matrix @ a + here.bias, atol=1e-9)
    # A rotor turns with its joint only: no momentum, no inertia of the whole changes.
    np.testing.assert_array_equal(here.centroidal_map, before.centroidal_map)
    np.testing.assert_array_equal(here.inertia, before.inertia)


def test_numbers_and_patterns_go_over_the_file(leg: Path) -> None:
    robot = Robot.load(leg, effort={"*": 50, "ankle": 20.0}, damping={"hip": 0.0}, friction=0.2)
    np.testing.assert_array_equal(robot.limits.effort, [50, 50, 20])
    np.testing.assert_array_equal(robot.model.lowerEffortLimit[6:], [-50, -50, -20])
    np.testing.assert_array_equal(robot.damping, [0.0, 0.9, 0.3])
    np.testing.assert_array_equal(robot.friction, [0.2, 0.2, 0.2])
    np.testing.assert_array_equal(robot.model.lowerDryFrictionLimit[6:], -robot.friction)
    np.testing.assert_array_equal(robot.armature, [0.02, 0.07, 0.02])
    assert not np.any(robot.model.armature[:6])
    locked = Robot.load(leg, locked={"hip": 0.1}, armature={"ankle": 0.4})
    np.testing.assert_array_equal(locked.armature, [0.07, 0.4])
    above = {str(f.name): str(locked.model.frames[f.parentFrame].name) for f in locked.model.frames}
    assert (above["hip"], above["thigh"], above["knee"]) == ("trunk", "hip", "thigh")
    again = pickle.loads(pickle.dumps(robot))
    for one in ("armature", "damping", "friction"):
        np.testing.assert_array_equal(getattr(again, one), getattr(robot, one))
        with pytest.raises(ValueError, match="read-only"):
            getattr(again, one)[0] = 1.0


@pytest.mark.parametrize(
    ("given", "error", "told"),
    [
        ({"effort": 0}, InvalidInputError, "effort: a joint without torque"),
        ({"effort": {"hip": -3}}, InvalidInputError, "effort of joint 'hip'"),
        ({"armature": np.nan}, InvalidInputError, "armature"),
        ({"damping": "a lot"}, InvalidInputError, "damping"),
        ({"friction": {3: 0.1}}, InvalidInputError, "friction: expected names as keys"),
        ({"damping": {"hpi": 0.1}}, UnknownNameError, "did you mean 'hip'"),
        ({"armature": [0.1, 0.1, 0.1]}, InvalidInputError, "armature"),
    ],
)
def test_mistakes_are_named(leg: Path, given, error: type[WbcError], told: str) -> None:
    with pytest.raises(error, match=re.escape(told)):
        Robot.load(leg, **given)


def test_joints_without_effort_are_named(leg: Path, robot_named) -> None:
    robot = Robot.load(leg)
    assert robot.limits.without_effort == ("hip", "ankle")
    assert any("no effort limit is given for hip, ankle:" in note for note in robot.notes)
    whole = Robot.load(leg, effort={"hip": 30, "ankle": 20})
    assert whole.limits.without_effort == ()
    assert not any("effort" in note for note in whole.notes)


def test_every_robot_of_the_library_can_carry_itself(robot_named) -> None:
    """Efforts are there, and standing on two feet with bent knees needs less than half of them."""
    for name in ("hoap2_like", "g1_27", "talos", "icub", "romeo"):
        robot = robot_named(name)
        assert not robot.limits.without_effort
        q = robot.posture("standing")
        here = robot.snapshot(q)
        weight = np.zeros((2, 6))
        feet = [robot.feet[side].frame for side in ("left", "right")]
        weight[:, 2] = 0.5 * 9.81 * robot.mass
        carried = sum(here.jacobian(f).T @ w for f, w in zip(feet, weight, strict=True))
        share = np.abs((here.bias - carried)[6:]) / robot.limits.effort
        assert share.max() < 0.5, (name, robot.joint_names[share.argmax()], share.max())


def test_a_rotor_that_turns_harder_than_the_robot_is_noted() -> None:
    """3 kg m^2 on a robot of 7 kg, whose own largest principal moment is 0.11 kg m^2."""
    robot = Robot.load("hoap2_like", armature={"left_knee_pitch": 3.0, "*ankle*": 0.1})
    (note,) = (note for note in robot.notes if "rotor" in note)
    assert "left_knee_pitch (3 kg m^2)" in note and "gear ratio squared" in note
    assert "ankle" not in note
    for name in ("hoap2_like", "g1", "talos"):
        assert not any("rotor" in note for note in Robot.load(name, armature=0.05).notes)


def test_a_rotor_moves_what_has_no_inertia_about_its_axis() -> None:
    """A point on the axis, as of sensors: the mass matrix is singular but for the rotor's 0.02."""
    links = urdf.link("a"), urdf.link("b", moment=0)
    text = urdf.robot("r", *links, urdf.joint("j", "a", "b"))
    with pytest.raises(ModelError, match="joint 'j', link 'b': nothing it moves has inertia"):
        Robot.load(text, feet={})
    robot = Robot.load(text, feet={}, armature=0.02)
    assert robot.snapshot(robot.postures["neutral"]).mass_matrix[6, 6] == pytest.approx(0.02)


Load = Callable[[str], Robot]


@pytest.mark.parametrize("name", ["hoap2_like", "g1", "talos", "icub", "romeo"])
def test_limits_are_those_of_the_file(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    limits = robot.limits
    joints = ET.parse(robot.path).findall("joint")
    found = {joint.get("name"): joint.find("limit") for joint in joints}
    assert limits.names == robot.joint_names
    for key in ("lower", "upper", "velocity", "effort"):
        written = [float(found[joint].get(key, "nan")) for joint in limits.names]
        np.testing.assert_array_equal(getattr(limits, key), written)


@pytest.fixture
def chain() -> Robot:
    """Wheel (continuous), rail (prismatic), elbow (revolute), wheel again; few limits."""
    kinds = {
        "wheel": ("continuous", '<limit effort="0" velocity="7"/>'),
        "rail": ("prismatic", '<limit lower="-0.5" upper="0.25" effort="20" velocity="0"/>'),
        "elbow": ("revolute", ""),
        "spinner": ("continuous", ""),
    }
    parts = [urdf.link(f"l{k}", at="0.1 0.1 0.1") for k in range(5)]
    for k, (name, (kind, limit)) in enumerate(kinds.items()):
        between = f"l{k}", f"l{k + 1}"
        parts.append(urdf.joint(name, *between, kind=kind, axis="0 0 1", limit=limit))
    return Robot.load(urdf.robot("chain", *parts))


def test_missing_limits_are_infinite_and_named(chain: Robot) -> None:
    limits = chain.limits
    assert limits.names == ("wheel", "rail", "elbow", "spinner")
    inf = np.inf
    np.testing.assert_array_equal(limits.lower, [-inf, -0.5, -inf, -inf])
    np.testing.assert_array_equal(limits.upper, [inf, 0.25, inf, inf])
    np.testing.assert_array_equal(limits.velocity, [7, inf, inf, inf])
    np.testing.assert_array_equal(limits.effort, [inf, 20, inf, inf])
    missing = "wheel: effort, rail: velocity, elbow: position, elbow: velocity, elbow: effort"
    assert ", ".join(limits.missing) == f"{missing}, spinner: velocity, spinner: effort"


def test_joint_positions_are_angles(chain: Robot) -> None:
    assert (chain.nq, chain.nv) == (13, 10)
    for wheel, spinner in ((0.3, -3.0), (np.pi / 2, -np.pi / 2), (3.1, 1.0)):
        q = np.zeros(chain.nq)
        q[6] = 1.0
        q[7:] = np.cos(wheel), np.sin(wheel), 0.2, -4.0, np.cos(spinner), np.sin(spinner)
        positions = chain.limits.joint_positions(q)
        np.testing.assert_allclose(positions, [wheel, 0.2, -4.0, spinner], atol=1e-15)


def test_joint_positions_of_many_and_how_far_they_are_past_limits(chain: Robot) -> None:
    rng, limits = np.random.default_rng(0), chain.limits
    qs = np.array([chain.integrate(chain.postures["neutral"], rng.normal(size=chain.nv), 1.0)
                   for _ in range(6)])  # fmt: skip
    positions = limits.joint_positions(qs.reshape(2, 3, -1))
    each = [limits.joint_positions(q) for q in qs]
    np.testing.assert_array_equal(positions.reshape(6, -1), each)
    for past, at in zip(limits.past(positions).reshape(6, -1), each, strict=True):
        for k, value in enumerate(at):
            beyond = [limits.lower[k] - value, value - limits.upper[k]]
            assert past[k] == max(beyond)
    assert (limits.past(np.full(4, np.nan)) > 0.0).sum() == 0


def test_limits_cannot_be_changed(hoap2: Robot) -> None:
    limits = hoap2.limits
    copied: JointLimits = pickle.loads(pickle.dumps(limits))
    for each in (limits, copied):
        for array in (each.lower, each.upper, each.velocity, each.effort):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0.0
    np.testing.assert_array_equal(copied.upper, limits.upper)


def test_joints_that_follow_others_need_no_effort(caplog: pytest.LogCaptureFixture) -> None:
    """They have no motor, at either level: their torque is 0, which no limit bounds."""
    bare = {"limit": urdf.limit().replace('effort="10"', 'effort="0"')}
    follower = urdf.joint("k", "b", "c", '<mimic joint="j"/>', **bare)
    links = (urdf.link(name, at="0 0 -0.1") for name in "abc")
    robot = Robot.load(urdf.robot("r", *links, urdf.joint("j", "a", "b"), follower), base="fixed")
    assert robot.limits.without_effort == ("k",) and missing_limits(robot) == ""
    s = robot.snapshot(robot.posture(joints={"j": 0.3}))
    torque = wbc.TorqueController(robot, [wbc.PostureTask(robot, s.q)]).step(s).torque
    assert abs(torque[0]) > 1.0 and abs(torque[1]) < 1e-12
    assert "effort" not in caplog.text
