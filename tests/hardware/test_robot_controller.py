"""What the controller knows of a robot before it commands."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from wbc.hardware.bus import BaseTruth, Reading
from wbc.hardware.robot_controller import RobotController, TruthEstimator
from wbc.problem import load_problem

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
