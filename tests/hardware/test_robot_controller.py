"""What the controller knows of a robot before it commands; what a simulated robot measures."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

pytest.importorskip("mujoco")

from wbc.estimation import ImuMount
from wbc.hardware.bus import BaseTruth, Command, Reading
from wbc.hardware.robot_controller import (
    EstimateError,
    RobotController,
    SensorEstimator,
    TruthEstimator,
)
from wbc.hardware.robot_side import RobotSettings
from wbc.hardware.setup import simulated_robot
from wbc.hardware.unitree.profiles import profile_named
from wbc.hardware.worker import Job, run_job
from wbc.problem import load_problem
from wbc.robot import Robot
from wbc.rotations import exp_rotation, rotation_from

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_load_of_the_feet_is_that_of_the_joints_torques(share: float) -> None:
    """By Pinocchio: recursive Newton-Euler at rest, forces on the soles; straps bear the rest."""
    problem = load_problem(PROBLEMS / "walk_g1.yaml")
    supervisor, robot, q = problem.supervisor_on_robot(), problem.parts.robot, problem.parts.start
    still = np.zeros(robot.nv)
    push = pin.StdVec_Force(robot.model.njoints, pin.Force.Zero())
    for foot in robot.feet.values():
        frame = robot.model.frames[robot.frame_id(foot.frame)]
        up = robot.snapshot(q).rotation(foot.frame).T @ (0.0, 0.0, 0.5 * share * robot.weight)
        push[frame.parentJoint] = frame.placement.act(pin.Force(up, np.array((0.3, -0.2, 0.1))))
    torque = pin.rnea(robot.model, robot.model.createData(), q, still, still, push)[6:]
    n, zero = len(torque), np.zeros(3)
    truth = BaseTruth(q[:7], still[:6])
    reading = Reading(
        0, 0.0, q[7:], np.zeros(n), torque, np.zeros(n), np.zeros(4), zero, zero, base_truth=truth
    )
    controller = RobotController(
        lambda: supervisor, TruthEstimator(robot), q, np.ones(n), np.ones(n)
    )
    # Not exactly: the moments on the soles are others than those of the least wrenches.
    assert controller.observe(reading).load == pytest.approx(share, abs=0.1)


def test_a_controller_that_had_no_estimate_to_begin_with_begins_at_the_next() -> None:
    """It commanded in the estimate's world, a metre from where the problem begins."""
    problem = load_problem(PROBLEMS / "stand_hoap2_like.yaml")
    robot, q = problem.parts.robot, problem.parts.start
    n, zero = robot.nv - 6, np.zeros(3)
    pose = q[:7] + (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0)
    rest = np.zeros(n)
    blind = Reading(0, 0.0, q[7:], rest, rest, rest, np.zeros(4), zero, zero)
    seen = replace(blind, sequence=1, time=0.002, base_truth=BaseTruth(pose, np.zeros(6)))
    controller = RobotController(
        problem.supervisor_on_robot, TruthEstimator(robot), q, np.ones(n), np.ones(n)
    )
    assert run_job(controller, Job(blind, True, True, False)).no_estimate
    answer = run_job(controller, Job(seen, False, True, False)).answer
    assert answer is not None and answer.q == pytest.approx(q, abs=1e-9)


def test_an_imu_may_be_mounted_anyhow_and_what_is_rejected_is_told(hoap2, rng) -> None:
    turned, n = exp_rotation(np.array((0.4, -1.2, 2.0))), hoap2.nv - 6
    mounted = SensorEstimator(hoap2, ImuMount("chest", "torso", (0.02, 0.0, 0.1), turned))
    q, zero = hoap2.posture(), np.zeros(n)

    def reading(k: int, jump: float = 0.0) -> Reading:
        spin, force = 1e-4 * rng.normal(size=(2, 3)) + ((0.0,) * 3, turned.T @ (0.0, 0.0, 9.81))
        joints = q[7:] + jump * (np.arange(n) == 3)
        return Reading(k, k * 0.002, joints, zero, zero, zero, np.zeros(4), spin, force)

    for k in range(250):
        with pytest.raises(EstimateError):
            mounted.update(reading(k))
    found, _ = mounted.update(reading(250))
    assert rotation_from(found[3:7]) == pytest.approx(np.eye(3), abs=1e-3)
    last = reading(251, jump=0.5)
    for _ in range(2):  # where a controller begins
        mounted.update(last)
    told = f"estimate, once: joint {hoap2.joint_names[3]}: position jumped; held"
    assert mounted.notes == (told,)


class Listener:
    """Keeps what is sent."""

    def __init__(self) -> None:
        self.dropped = Counter[str]()
        self.readings = list[Reading]()

    def receive(self) -> Command | None:
        return None

    def send(self, reading: Reading) -> None:
        self.readings.append(reading)

    def close(self) -> None: ...


def test_the_imu_measures_where_it_is(g1: Robot) -> None:
    """Its readings integrate to the motion of its frame, by Pinocchio, of a robot that is thrown.

    Readings at the base, 0.095 m aside, end 5 mm off after 0.2 s.
    """
    listener, profile = Listener(), profile_named("unitree_g1")
    assert profile.mount(g1).frame == "imu_in_pelvis"
    quiet = dict.fromkeys(
        ("velocity_noise", "gyroscope_noise", "accelerometer_noise", "orientation_noise"), 0.0
    )
    settings = RobotSettings(0.001, encoder=1e-12, truth=True, gantry=False, **quiet)
    side = simulated_robot(g1, profile, listener, settings, lifted=0.5)
    side.push(0.0, "pelvis", (400.0, 300.0, 200.0), 0.05)
    for k in range(200):
        side.step(0.001 * k)
    readings, gravity, positions, rotations = listener.readings, (0.0, 0.0, -9.81), [], []
    for one in readings:
        assert one.base_truth is not None
        here = g1.snapshot(np.concatenate((one.base_truth.pose, one.position)))
        positions.append(here.position("imu_in_pelvis"))
        rotations.append(here.rotation("imu_in_pelvis"))
    dt = np.diff([one.time for one in readings])
    velocity = (positions[1] - positions[0]) / dt[0]
    place, R = positions[1], rotations[1]
    for one, step in zip(readings[2:], dt[1:], strict=True):
        R = R @ exp_rotation(step * one.angular_velocity)
        velocity = velocity + step * (rotation_from(one.quaternion) @ one.specific_force + gravity)
        place = place + step * velocity
    np.testing.assert_allclose(place, positions[-1], atol=5e-5)  # Euler's error
    np.testing.assert_allclose(R, rotations[-1], atol=1e-2)
