"""A task of your own: look at a point in the room.

A task is an error and its Jacobian, in one method. The error here is the part of the vector to the
point that is not along the camera's axis: two numbers, zero when the camera looks at the point.
"""

from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

import wbc


class GazeTask(wbc.Task):
    """Point the x axis of ``frame`` at ``point`` (3,) [m], world axes."""

    def __init__(
        self,
        robot: wbc.Robot,
        frame: str,
        point: ArrayLike,
        *,
        name: str = "gaze",
        **law: Unpack[wbc.Gains],
    ) -> None:
        super().__init__(robot, name, ("left", "up"), **law)
        self.frame = frame
        self.point = np.array(point, dtype=float)

    def residual(self, snapshot: wbc.Snapshot) -> wbc.Residual:
        """Return the point's distance from the axis [m], to the camera's left and up."""
        R, J = snapshot.rotation(self.frame), snapshot.jacobian(self.frame)
        in_camera = R.T @ (self.point - snapshot.position(self.frame))
        # p = in_camera: dp/dt = -R' v - w x p in camera axes; error = actual - target = -p.
        x, y, z = in_camera
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])  # p x
        rate = -R.T @ J[:3] + cross @ (R.T @ J[3:])
        return wbc.Residual(-in_camera[1:], -rate[1:], np.zeros(2))


robot = wbc.Robot.load("hoap2_like")
q, v, dt = robot.posture("standing"), None, 0.005
start = robot.snapshot(q)

# Check the Jacobian by finite differences: the first thing to do with a task of your own.
task = GazeTask(robot, "head", (1.0, 0.4, 0.1))
direction = np.random.default_rng(0).normal(size=robot.nv)
step = 1e-6
ahead, behind = (robot.snapshot(robot.integrate(q, direction, s)) for s in (step, -step))
numeric = (task.residual(ahead).error - task.residual(behind).error) / (2.0 * step)
mismatch = np.abs(numeric - task.residual(start).rate(direction)).max()

tasks = [task, wbc.ComTask(robot, start.com, weight=10.0), wbc.PostureTask(robot, q, weight=0.01)]
controller = wbc.KinematicController(
    robot, tasks, contacts=wbc.support(start, "double"), limits=wbc.Limits(robot), dt=dt
)
for _ in range(400):
    tick = controller.step(robot.snapshot(q, v))
    v = tick.velocity
    q = robot.integrate(q, v, dt)
off = 1e3 * np.linalg.norm(tick.errors["gaze"])
print(f"Jacobian off by {mismatch:.1e}; the line of sight passes the point at {off:.2f} mm")
