"""What a walking robot's tasks give each other when not all can be had; what is known of legs."""

from collections.abc import Callable
from dataclasses import astuple, replace
from typing import cast

import numpy as np
import pytest

from tests.conftest import load
from tests.urdf import drawn_along, on_both_legs
from wbc.constraints import Limits
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import InvalidInputError
from wbc.gait.legs import Legs
from wbc.gait.swing import FootPose
from wbc.gait.walker import FRICTION
from wbc.gait.whole_body import REFERENCE_HIPS, WalkingWeights, WholeBody
from wbc.robot import Robot, Snapshot
from wbc.robot.chains import leg_joints
from wbc.validate import Array

Load = Callable[[str], Robot]


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
