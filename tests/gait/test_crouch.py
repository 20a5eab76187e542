"""The posture that a walk is drawn to: knees bent as far as the height of the gait asks."""

import re
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.urdf import on_both_legs
from wbc.gait import Walker
from wbc.gait.crouch import walking_posture
from wbc.gait.legs import STRETCH, Legs, bent_backwards, knee_bends, knees_one_way
from wbc.robot import Robot
from wbc.simulation import Plant
from wbc.tasks import PostureTask


@pytest.fixture
def straight(hoap2: Robot, tmp_path: Path) -> Robot:
    """A robot as from a file that says nothing of how it stands, whose knees bend both ways."""
    knee = r'(name="(?:left|right)_knee(?:_pitch)?".*?<limit[^>]*?lower=")[^"]*'
    text = on_both_legs(hoap2.path.read_text(), knee, r"\g<1>-0.4")
    (tmp_path / "straight.urdf").write_text(text)
    robot = Robot.load(tmp_path / "straight.urdf")
    assert not robot.posture("standing")[7:].any()
    return robot


def knees(robot: Robot) -> list[int]:
    return [k for k, name in enumerate(robot.joint_names) if "knee" in name]


def past_straight(hoap2: Robot, hip: float) -> Robot:
    """Return a robot that stands at zero with its knees bent backwards by twice ``hip`` [rad]."""
    text = hoap2.path.read_text()
    for joint, turn in (("hip_pitch", hip), ("knee(?:_pitch)?", -2.0 * hip), ("ankle_pitch", hip)):
        pattern = rf'(<joint name="(?:left|right)_{joint}".*?rpy=")0 0 0'
        text = on_both_legs(text, pattern, rf"\g<1>0 {turn} 0")
    return Robot.load(text, base="floating")


def test_straight_legs_bend_their_knees_to_the_gaits_height(straight: Robot) -> None:
    """Places of feet, trunk and CoM by Pinocchio."""
    walker = Walker(straight)
    (posture,) = (task for task in walker.controller.tasks if isinstance(task, PostureTask))
    start, model = straight.posture("standing"), straight.model
    q = walking_posture(straight.snapshot(start), walker.gait.height)
    np.testing.assert_array_equal(posture.target[7:], q[7:])
    ahead, behind = model.createData(), model.createData()
    for data, configuration in ((behind, start), (ahead, q)):
        pin.framesForwardKinematics(model, data, configuration)
        pin.centerOfMass(model, data, configuration, False)
    for foot in straight.feet.values():
        k = model.getFrameId(foot.frame)
        np.testing.assert_allclose(ahead.oMf[k].homogeneous, behind.oMf[k].homogeneous, atol=2e-3)
    np.testing.assert_allclose(ahead.oMi[1].rotation, behind.oMi[1].rotation, atol=2e-3)
    np.testing.assert_allclose(ahead.com[0][:2], behind.com[0][:2], atol=2e-3)
    assert ahead.com[0][2] == pytest.approx(walker.gait.height, abs=2e-3)
    assert ahead.com[0][2] < behind.com[0][2] - 5e-3
    angles = straight.limits.joint_positions(q)
    assert (angles[knees(straight)] > 0.3).all()  # not the way that has 0.4 rad only
    assert (angles <= straight.limits.upper).all() and (angles >= straight.limits.lower).all()


@pytest.mark.parametrize("axis", [1, -1])
def test_knees_without_a_range_bend_ahead(hoap2: Robot, axis: int) -> None:
    """Of a RoboCup robot's file: they bent backwards, in walks and retargeted, and nobody said."""
    text = re.sub(r'<limit lower="[^"]*" upper="[^"]*"', "<limit", hoap2.path.read_text())
    text = text.replace('type="revolute"', 'type="continuous"')
    pattern = r'(<joint name="(?:left|right)_knee(?:_pitch)?".*?<axis xyz=")0 1 0'
    text = on_both_legs(text, pattern, rf"\g<1>0 {axis} 0")
    robot = Robot.load(text, base="floating")
    start = robot.snapshot(robot.posture("standing"))
    q = walking_posture(start, Walker(robot).gait.height)
    assert (axis * robot.limits.joint_positions(q)[knees(robot)] > 0.3).all()


@pytest.mark.parametrize("axis", [1, -1])
def test_knees_with_as_much_range_on_both_sides_are_given_one(hoap2: Robot, axis: int) -> None:
    """As a HighTorque Pi plus' are: straight legs that stepped bent backwards."""
    assert knees_one_way(hoap2) is hoap2
    pattern = (
        r'(<joint name="(?:left|right)_knee(?:_pitch)?".*?<axis xyz=")0 1 0(.*?)'
        r'<limit lower="[^"]*" upper="[^"]*"'
    )
    turned = rf'\g<1>0 {axis} 0\g<2><limit lower="-2" upper="2"'
    text = on_both_legs(hoap2.path.read_text(), pattern, turned)
    robot = Robot.load(text, base="floating")
    limits = knees_one_way(robot).limits
    bent = knees(robot)
    ends = np.sort(axis * np.array((limits.lower[bent], limits.upper[bent])), axis=0)
    np.testing.assert_allclose(ends, [[0.0, 0.0], [2.0, 2.0]], atol=0.07)
    others = np.delete(np.arange(len(limits.names)), bent)
    np.testing.assert_array_equal(limits.lower[others], robot.limits.lower[others])


def test_knees_that_stand_past_straight_bend_the_way_they_can(hoap2: Robot) -> None:
    """As a RoboCup robot's at zero: its weight held such knees at their limits as it walked."""
    robot = past_straight(hoap2, 0.25)
    start = robot.snapshot(robot.posture("standing"))
    legs = Legs.of(robot)
    assert legs.hip_height < STRETCH * legs.length  # which is how straight legs were told
    assert bent_backwards(start) and not bent_backwards(hoap2.snapshot(hoap2.posture("standing")))
    height = Walker(robot).gait.height
    q = walking_posture(start, height)
    assert (robot.limits.joint_positions(q)[knees(robot)] > 0.5 + 0.2).all()  # 0.5 is straight
    assert robot.snapshot(q).com[2] == pytest.approx(height, abs=2e-3)


def test_knees_a_little_past_straight_bend_before_the_robot_sinks(hoap2: Robot) -> None:
    """Asked to sink at once it leant back, seven times as far; a Kuavo (MJCF) by 0.5 rad."""
    robot = past_straight(hoap2, 0.05)
    walker = Walker(robot)
    plant, tilt = Plant(robot, dt=walker.dt), 0.0
    plant.reset(robot.posture("standing"))
    for _ in range(round(0.8 / walker.dt)):
        plant.step(walker.step(plant.snapshot(), plant.contact_forces).torque)
        tilt = max(tilt, float(np.arccos(plant.snapshot().rotation("base")[2, 2])))
    assert tilt < 2e-3
    assert plant.com[2] == pytest.approx(walker.gait.height, abs=1e-3)


@pytest.mark.parametrize("beyond", [0.0, 0.005])  # all the way out, and not quite
def test_legs_that_telescope_walk(hoap2: Robot, beyond: float) -> None:
    """A knee that slides has no axis, and was sought among those that are parallel to it."""
    text = on_both_legs(
        hoap2.path.read_text(),
        r'(<joint name="(?:left|right)_knee(?:_pitch)?" type=")revolute(".*?<axis xyz=")0 1 0'
        r'(" */>\s*<limit lower=")[^"]*" upper="[^"]*" effort="9"',
        rf'\g<1>prismatic\g<2>0 0 -1\g<3>-0.08" upper="{beyond}" effort="300"',
    )
    robot = Robot.load(text, base="floating")
    start = robot.snapshot(robot.posture("standing"))
    height = Walker(robot).gait.height
    q = walking_posture(start, height)
    assert height < start.com[2] - 5e-3
    if not beyond:
        assert (robot.limits.joint_positions(q)[knees(robot)] < -5e-3).all()
        assert robot.snapshot(q).com[2] == pytest.approx(height, abs=2e-3)


def test_bent_and_given_knees_are_left_alone(hoap2: Robot, straight: Robot) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"))
    assert walking_posture(start, 0.2) is start.q
    given = straight.snapshot(straight.posture("standing", {"*_knee*": 0.01}))
    assert walking_posture(given, 0.2) is given.q


def test_straight_legs_bend_wherever_the_robot_stands_and_whatever_its_arms_do(straight) -> None:
    """An H1_2 with a payload, by a file: on legs drawn straight it leant back by 0.44 rad."""
    q = straight.posture("standing", {"head_yaw": 0.1, "*_elbow_pitch": -0.7, "left_*_roll": 0.05})
    q[:3] += (2.0, 1.0, 1e-13)
    start, height = straight.snapshot(q), Walker(straight).gait.height
    bent = walking_posture(start, height)
    for name, angle, before in zip(
        straight.limits.names,
        straight.limits.joint_positions(bent),
        start.joint_positions,
        strict=True,
    ):
        if "knee" in name:
            assert angle > 0.3
        if "head" in name or "elbow" in name:
            assert angle == pytest.approx(before, abs=0.05)
    now, soles = straight.snapshot(bent), ("left_sole", "right_sole")
    for sole in soles:
        np.testing.assert_allclose(now.position(sole), start.position(sole), atol=2e-3)
    middle = np.mean([start.position(sole)[2] for sole in soles])
    assert now.com[2] == pytest.approx(middle + height, abs=2e-3)


def test_a_height_that_no_posture_has_is_said(straight, caplog) -> None:
    start = straight.snapshot(straight.posture("standing"))
    assert walking_posture(start, 0.01) is start.q
    assert "no posture with bent knees" in caplog.text


def test_legs_of_a_robot_whose_file_faces_sideways_are_the_same(hoap2: Robot) -> None:
    """Speeds of its swings were half, by the roll of its hips, and its knees bent backwards."""
    text = re.sub(r'<limit lower="[^"]*" upper="[^"]*"', "<limit", hoap2.path.read_text())
    endless = text.replace('type="revolute"', 'type="continuous"')
    for robot in (hoap2, Robot.load(endless, base="floating")):
        turn = np.zeros(robot.nv)
        turn[5] = 0.5 * np.pi
        sideways = robot.integrate(robot.posture(), turn, 1.0)
        turned = replace(robot, postures={**robot.postures, "standing": sideways})
        legs, same = Legs.of(turned), Legs.of(robot)
        assert asdict(legs) == pytest.approx(asdict(same), rel=1e-9)
        assert knee_bends(turned, 0.9 * legs.length) == pytest.approx(
            knee_bends(robot, 0.9 * legs.length)
        )
