"""What legs lack for walking is said before; what tasks give each other, and legs measured."""

import logging
from dataclasses import astuple, replace
from typing import cast

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import load
from tests.urdf import drawn_along, on_both_legs
from wbc.constraints import Contact, Limits, LineContact, support
from wbc.constraints.sole_contacts import _tell_lines, rolls
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import InvalidInputError
from wbc.gait import Velocity, Walker
from wbc.gait.ability import bearing_torques, pressure_offset
from wbc.gait.legs import Legs
from wbc.gait.scheduled_walk import ScheduledWalk, TimedCommand
from wbc.gait.swing import FootPose
from wbc.gait.walker import FRICTION
from wbc.gait.whole_body import REFERENCE_HIPS, WalkingWeights, WholeBody
from wbc.problem import load_problem
from wbc.robot import Robot, Snapshot
from wbc.robot.chains import leg_joints
from wbc.robot.passive import PassiveForces, Spring
from wbc.simulation import Plant, simulate
from wbc.validate import Array


@pytest.mark.parametrize(("name", "ahead"), [("hoap2_like", 0.0), ("g1", 0.0), ("g1", -0.03)])
def test_bearing_torques_are_those_of_a_tilted_gravity(name: str, ahead: float) -> None:
    """By Pinocchio: recursive Newton-Euler at rest, with gravity along the pressure's line.

    A spring takes -k x off its joint.
    """
    joint = load(name).joint_names[3]
    robot: Robot = replace(load(name), passive=PassiveForces({joint: Spring(8.0, (0, 0), 0.3)}))
    s = robot.snapshot(robot.posture())
    foot = robot.feet["left"].frame
    R = s.rotation(foot)
    model, arm = robot.model.copy(), s.com - s.position(foot) - ahead * R[:, 0]
    model.gravity.linear = -9.81 / arm[2] * arm
    force = -robot.mass * model.gravity.linear
    frame = model.frames[robot.frame_id(foot)]
    push = pin.StdVec_Force(model.njoints, pin.Force.Zero())
    local = pin.Force(R.T @ force, np.cross([ahead, 0.0, 0.0], R.T @ force))
    push[frame.parentJoint] = frame.placement.act(local)
    zero = np.zeros(robot.nv)
    tau = pin.rnea(model, model.createData(), s.q, zero, zero, push)
    np.testing.assert_allclose(tau[:6], 0.0, atol=1e-9)  # the line goes through the CoM
    tau[9] += 8.0 * (s.joint_positions[3] - 0.3)
    np.testing.assert_allclose(bearing_torques(s, foot, ahead), tau[6:], atol=1e-9)


@pytest.mark.parametrize("name", ["hoap2_like", "g1"])
def test_robots_that_walk_lack_nothing(name: str) -> None:
    assert Walker(load(name)).notes == ()


def test_weak_joints_are_named(caplog: pytest.LogCaptureFixture) -> None:
    robot = Robot.load("hoap2_like", effort={"*_hip_roll": 1.5})
    with caplog.at_level(logging.WARNING):
        (note,) = Walker(robot).notes
    assert "left_hip_roll takes 2.09 and has 1.5, right_hip_roll" in note
    assert "left_ankle" not in note
    assert note.endswith("give the joint's, as effort={'left_hip_roll': ...}")
    assert note in caplog.text
    assert Walker(robot, torque_limits=None).notes == ()  # they are not bounded there
    assert Walker(robot, torque_limits=2.0).notes == ()


def weak_ankles() -> Robot:
    return Robot.load("g1", effort={"*_ankle_pitch_joint": 11.0}, armature=0.003)


def test_pressure_is_led_to_where_weak_ankles_bear_with_half_of_their_torque() -> None:
    robot = weak_ankles()
    s = robot.snapshot(robot.posture())
    ahead = pressure_offset(s, robot.limits.effort)
    ankle = robot.joint_index("left_ankle_pitch_joint") - 6
    assert -0.04 < ahead < -0.02
    assert bearing_torques(s, robot.feet["left"].frame, ahead)[ankle] == pytest.approx(5.5)
    assert pressure_offset(s, load("g1").limits.effort) == 0.0  # 50 N m
    (note,) = Walker(robot).notes
    assert f"the CoP's target is {-1e3 * ahead:.0f} mm behind the middle of soles" in note


@pytest.mark.slow
def test_robots_with_weak_ankles_go_where_they_are_told_to() -> None:
    """Led to the middle of the soles the pressure is behind it: it went by 0.37 and -0.13 m/s."""
    walker = Walker(weak_ankles())
    plant = Plant(walker.robot, dt=0.002)
    commands = [TimedCommand(0.2, Velocity(0.3, 0.0, 0.0)), TimedCommand(3.0, Velocity(-0.2, 0, 0))]
    walk = ScheduledWalk(walker, commands, lambda: plant.felt_forces)
    ahead = [plant.com[0] for _ in simulate(walker.controller, plant, 7.0, update=walk.update)]
    assert abs((ahead[1500] - ahead[750]) / 1.5 - 0.3) < 0.03
    assert abs((ahead[-1] - ahead[-1000]) / 2.0 + 0.2) < 0.03


def test_dry_friction_that_takes_much_of_the_torque_is_said() -> None:
    knees = {"*_knee_pitch": 2.0}
    robot = Robot.load("hoap2_like", friction=knees)
    (note,) = Walker(robot).notes
    assert Walker(robot, friction_compensation=0.8).notes == ()
    assert (
        "dry friction takes up to 22 % of the torque of left_knee_pitch, right_knee_pitch: without"
        in note
    )
    assert Walker(Robot.load("hoap2_like", friction={"*": 0.1})).notes == ()


def test_a_joint_that_swings_freely_is_said_to_have_nothing() -> None:
    """Of no loop and no gear: it ended in NumPy's error."""
    robot = Robot.load("hoap2_like", friction={"*": 0.1}, unactuated=["left_ankle_roll"])
    (note,) = Walker(robot).notes
    assert "left_ankle_roll takes 0.378 and has 0 N m" in note


def without(joint: str, half_width: float) -> Robot:
    """A small humanoid without a joint of either leg, on soles of that half width [m]."""
    polygon = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (0.047, half_width)
    feet = {side: {"link": f"{side}_sole", "polygon": polygon} for side in ("left", "right")}
    locked = {f"{side}_{joint}": 0.0 for side in ("left", "right")}
    return Robot.load("hoap2_like", locked=locked, feet=feet)


@pytest.mark.parametrize(
    ("joint", "half_width", "kind"),
    [
        ("ankle_roll", 0.01, LineContact),
        ("ankle_roll", 0.031, Contact),  # wide enough to stay flat
        ("hip_yaw", 0.01, Contact),  # five joints, too, of which the ankle's rolls the sole
    ],
)
def test_feet_are_held_along_their_length_where_legs_cannot_roll_them(
    joint: str, half_width: float, kind: type[Contact], caplog: pytest.LogCaptureFixture
) -> None:
    robot = without(joint, half_width)
    _tell_lines.cache_clear()  # said once of each robot
    start = robot.snapshot(robot.posture("standing"))
    assert {type(one) for one in support(start, "double")} == {kind}
    assert ("cannot roll their narrow soles" in caplog.text) == (kind is LineContact)
    walker = Walker(robot)
    assert {type(one) for one in walker.controller.contacts} == {kind}
    said = " ".join(walker.notes)
    assert ("the left leg and the right leg cannot roll the sole" in said) == (joint != "hip_yaw")
    assert ("held along its length only (LineContact)" in said) == (kind is LineContact)


def test_legs_that_no_joint_turns_are_not_told_to_turn() -> None:
    admitted = Walker(without("hip_yaw", 0.031)).command(0.0, 0.0, 0.5)
    assert admitted.velocity == (0.0, 0.0, 0.0)
    assert admitted.reason == (
        "0.5 rad/s is beyond the turn of legs without a joint for it: 0 rad/s"
    )


@pytest.mark.slow
def test_feet_that_are_edges_ahead_walk_and_those_across_are_refused() -> None:
    feet = {side: {"link": f"{side}_sole"} for side in ("left", "right")}
    ahead, across = (
        Robot.load("hoap2_like", feet={key: {**one, "polygon": ends} for key, one in feet.items()})
        for ends in ([[-0.047, 0.0], [0.047, 0.0]], [[0.0, -0.03], [0.0, 0.03]])
    )
    walker = Walker(ahead)
    plant = Plant(ahead, dt=0.002)
    command = [TimedCommand(0.2, Velocity(0.1, 0.0, 0.0))]
    walk = ScheduledWalk(walker, command, lambda: plant.felt_forces)
    *_, last = simulate(walker.controller, plant, 5.0, update=walk.update)
    assert last.verdict.stood, last.verdict.reason
    assert plant.com[0] > 0.8 * 0.1 * 4.0
    with pytest.raises(InvalidInputError, match=r"edges across its way, with left_sole, right"):
        Walker(across)


@pytest.mark.slow
@pytest.mark.parametrize("push", [0.0, 10.0])
def test_legs_without_an_ankle_roll_walk_on_narrow_soles(push: float) -> None:
    """Held in all six rows their soles tip unforeseen, and it falls after a second."""
    walker = Walker(without("ankle_roll", 0.005))
    plant = Plant(walker.robot, dt=0.002)
    plant.push("base", [0.0, push, 0.0], "com", start=2.0, duration=0.1)
    walk = ScheduledWalk(
        walker, [TimedCommand(0.2, Velocity(0.1, 0.0, 0.0))], lambda: plant.felt_forces
    )
    *_, last = simulate(walker.controller, plant, 5.0, update=walk.update)
    assert last.verdict.stood, last.verdict.reason
    assert plant.com[0] > 0.8 * 0.1 * 4.0


def test_feet_are_lifted_as_fast_as_damped_motors_turn_their_knees(hoap2: Robot) -> None:
    """Where damping takes all of a motor's torque its speed ends: at 2 and at 1 rad/s here."""
    effort = float(hoap2.limits.effort[hoap2.joint_index("left_knee_pitch") - 6])
    assert hoap2.limits.velocity[hoap2.joint_index("left_knee_pitch") - 6] > 2.0
    usual, slow, slower = (
        Walker(Robot.load("hoap2_like", damping={"*_knee_pitch": damping})).gait.clearance
        for damping in (0.0, effort / 2.0, effort)
    )
    assert slow < 0.9 * usual
    assert slower == pytest.approx(0.5 * slow, rel=1e-12)


def test_a_simulation_says_it_too(tmp_path) -> None:
    file = tmp_path / "walk.yaml"
    file.write_text(
        "robot: {model: hoap2_like, effort: {left_hip_roll: 1.5}}\n"
        "gait: {commands: [{at: 0.0, vx: 0.1}]}\n"
        "simulation: {duration: 0.01}\n"
    )
    result = load_problem(file).simulate()
    assert any("left_hip_roll takes 2.09 and has 1.5" in note for note in result.notes)


def test_straight_legs_that_lean_aside_can_roll_their_soles(hoap2: Robot) -> None:
    """They could not to the bit, and retargeting let a Berkeley Humanoid Lite stand on edges."""
    pattern = r'(<joint name="(?:left|right)_ankle_pitch".*?xyz=")0 0 '
    text = on_both_legs(hoap2.path.read_text(), pattern, r"\g<1>0 0.02 ")
    robot = Robot.load(text, base="floating")
    posture = robot.snapshot(robot.posture("standing"))
    assert rolls(posture, "left") and rolls(posture, "right")


def led_on_the_left_foot(start: Snapshot, asked: Array) -> tuple[TorqueTick, Array]:
    """A tick on the left foot, the right one asked for ``asked`` (6,); where the CoP should be."""
    robot = start.robot
    left, right = (robot.feet[side] for side in ("left", "right"))
    height = float(start.com[2])
    body = WholeBody(start, 0.0, height, WalkingWeights(), FRICTION, limits=Limits(robot), dt=0.002)
    body.hold(start, ["left"], 0.001)
    ahead = np.array((0.5 * left.polygon.max(axis=0)[0], 0.0, 0.0))
    pose = start.position(right.frame), start.rotation(right.frame)
    body.swing("right", FootPose(*pose, np.zeros(6), asked))
    pressure = start.position(left.frame) + ahead
    body.set_targets(start, pressure, np.array((height, 0.0, 0.0)), 0.0, 0.0)
    for _ in range(3):  # the right foot gives up its load within one
        tick = cast(TorqueTick, body.controller.step(start))
    return tick, ahead[:2]


def test_a_foot_that_hurries_keeps_its_height(g1: Robot) -> None:
    """A leg that is behind, swung by its hip alone, would take the foot down by a third of that.

    With hips that speed up as they can be counted on to brake, it had 27 m/s^2 of these 60.
    """
    behind = {"right_hip_pitch_joint": 0.3, "right_knee_joint": 0.4}
    behind["right_ankle_pitch_joint"] = -sum(behind.values())
    start = g1.snapshot(g1.posture("standing", behind))
    frame = g1.feet["right"].frame
    assert start.position(frame)[0] < start.position(g1.feet["left"].frame)[0] - 0.2
    tick, _ = led_on_the_left_foot(start, np.array((60.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    x, _, z = start.jacobian(frame)[:3] @ tick.acceleration
    assert x > 0.6 * 60.0
    assert abs(z) < 1.0


def test_legs_speed_up_as_their_torques_allow(g1: Robot) -> None:
    """Other joints as they can be counted on to brake, and all where accelerations are given."""
    start, height = g1.snapshot(g1.posture("standing")), 0.6

    def speed_up(limits: Limits) -> Array | None:
        made = WholeBody(start, 0.0, height, WalkingWeights(), FRICTION, limits=limits, dt=0.002)
        assert made.controller.limits is not None
        return made.controller.limits.speed_up

    plain = Limits(g1)
    freed = speed_up(plain)
    assert freed is not None and plain.speed_up is None
    legs = [any(part in name for part in ("hip", "knee", "ankle")) for name in g1.joint_names]
    np.testing.assert_array_equal(np.isinf(freed), legs)
    assert speed_up(Limits(g1, acceleration=50.0)) is None


def test_weak_hips_hold_a_foot_up_less_firmly(g1: Robot) -> None:
    """In proportion, below so many times gravity: else they throw the pelvis over."""
    legs, weights = Legs.of(g1), WalkingWeights(lift=50.0)
    assert legs.swing_acceleration > REFERENCE_HIPS * legs.gravity
    assert weights.for_legs(legs) == weights
    weak = replace(legs, swing_acceleration=0.5 * REFERENCE_HIPS * legs.gravity)
    assert weights.for_legs(weak) == replace(weights, lift=25.0)


@pytest.mark.parametrize("name", ["g1", "icub"])
def test_a_foot_that_hurries_leaves_the_pressure_where_it_is_wanted(robot_named, name) -> None:
    """At 60 m/s^2; the CoP is that of the planned wrench."""
    robot = robot_named(name)
    start = robot.snapshot(robot.posture("standing"))
    left = robot.feet["left"]
    half = left.polygon.max(axis=0)
    tick, wanted = led_on_the_left_foot(start, np.array((60.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
    force, moment = np.split(tick.forces[left.frame], 2)
    pressure = np.array((-moment[1], moment[0])) / force[2]  # from the frame, on the ground
    off = np.abs(pressure - wanted)
    assert (off < 0.3 * half).all()
    foot = start.jacobian(robot.feet["right"].frame)[0] @ tick.acceleration
    assert foot > 0.92 * 60.0


@pytest.mark.parametrize("name", ["hoap2_like", "g1"])
def test_legs_are_measured_wherever_joints_are_drawn_along_their_axes(name: str) -> None:
    """The same mechanism with other origins: one was refused, for hips too near its ankles."""
    text, rng = load(name).path.read_text(), np.random.default_rng(1)
    robot = Robot.load(text, base="floating")
    joints = [robot.model.names[joint] for foot in robot.feet for joint in leg_joints(robot, foot)]
    shifts = dict(zip(joints, rng.uniform(-0.1, 0.1, len(joints)).tolist(), strict=True))
    moved = Robot.load(drawn_along(text, shifts), base="floating")
    masses = [one.snapshot(one.posture("standing")).mass_matrix for one in (robot, moved)]
    np.testing.assert_allclose(*masses, atol=1e-9)
    np.testing.assert_allclose(astuple(Legs.of(moved)), astuple(Legs.of(robot)), rtol=1e-6)


def test_knees_that_lift_no_foot_are_refused(hoap2: Robot) -> None:
    text = on_both_legs(
        hoap2.path.read_text(), r'(_knee_pitch".*?<limit [^/]*?upper=")[^"]*', r"\g<1>0.05"
    )
    with pytest.raises(InvalidInputError, match="left_knee_pitch, does not shorten it to 80 % of"):
        Legs.of(Robot.load(text))
