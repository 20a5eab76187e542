"""What type checkers make of code like a user's; run by check.py, never imported.

Each mistake is marked as one: a checker that misses it says that the mark is of no use.
"""

from typing import Unpack, assert_type

import numpy as np
from numpy.typing import NDArray

import wbc
from wbc.estimation import ImuReading
from wbc.gait import Wall
from wbc.simulation import Step

robot = wbc.Robot.load("hoap2_like")
start = robot.snapshot(robot.posture("standing"))

com = wbc.ComTask(robot, start.com, weight=10.0, priority=1, gain=0.3, kp=50.0, kd=None)
momentum = wbc.MomentumTask(robot, kd=10.0)
limits = wbc.Limits(robot, braking="bounded")
velocities = wbc.KinematicController(robot, [com, momentum], contacts=(), limits=limits)
torques = wbc.TorqueController(robot, [com], contacts=wbc.support(start, "double"))
assert_type(velocities.step(start), wbc.Tick)
assert_type(torques.step(start), wbc.TorqueTick)

# What is read as an array takes whatever makes one.
com.weight = 3
com.weight = [1.0, 2.0, 3.0]
com.target = (0.0, 0.0, 0.3)
com.gain = 0.2
limits.acceleration = 20.0
limits.speed = np.ones(robot.nv - 6)
pose = wbc.PoseTask(robot, "left_sole", [0.0, 0.0, 0.0], np.eye(3))
pose.position = [0.0, 0.0, 0.1]
q: NDArray[np.float64] = start.q  # as most annotate arrays
Wall(point=(0.0, 0.5, 0.9), normal=(0.0, -1.0, 0.0))
Step(centre=(0.2, 0.0, 0.03), size=(0.2, 0.5, 0.03))
ImuReading("imu", [0.0, 0.0, 0.0], [0.0, 0.0, 9.81])
heights: list[float] = [pose.position[2], *com.weight.tolist()]


class Own(wbc.Task):
    """A task of a user's, whose keywords are checked too."""

    def __init__(self, robot: wbc.Robot, **law: Unpack[wbc.Gains]) -> None:
        super().__init__(robot, "own", ("x",), **law)

    def residual(self, snapshot: wbc.Snapshot) -> wbc.Residual:
        """Return nothing of interest."""
        return wbc.Residual(np.zeros(1), np.zeros((1, robot.nv)), np.zeros(1))


Own(robot, weight=2.0)

# Mistakes.
wbc.ComTask(robot, start.com, weigth=3)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
Own(robot, weigth=3)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
wbc.ComTask(robot, start.com, gain="a")  # type: ignore[arg-type]  # pyright: ignore[reportArgumentType]
wbc.MomentumTask(robot, gain=0.3)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
wbc.LoadShareTask(robot)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
wbc.Limits(robot, margn=0.1)  # type: ignore[call-arg]  # pyright: ignore[reportCallIssue]
com.targett = (0, 0, 0)  # type: ignore[attr-defined]  # pyright: ignore[reportAttributeAccessIssue]
limits.sped = 1.0  # type: ignore[attr-defined]  # pyright: ignore[reportAttributeAccessIssue]
torques.dampng = 1.0  # type: ignore[attr-defined]  # pyright: ignore[reportAttributeAccessIssue]
print(velocities.step(start).torque)  # type: ignore[attr-defined]  # pyright: ignore
print(wbc.ComTsk)  # type: ignore[attr-defined]  # pyright: ignore
print(wbc.view.Viwer)  # type: ignore[attr-defined]  # pyright: ignore
