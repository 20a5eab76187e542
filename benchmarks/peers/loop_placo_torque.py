"""Torques with PlaCo: python loop_placo_torque.py JOB.json."""

from importlib.metadata import version

import numpy as np
import placo
from loop_placo import Stepped, started
from serve import KP, serve


class Loop(Stepped):
    """The robot moves as computed: no physics."""

    def __init__(self, job):
        self.job = job
        self.robot = robot = started(job)
        self.solver = solver = placo.DynamicsSolver(robot)
        solver.dt = job.dt
        solver.enable_torque_limits(True)
        for name, most in job.efforts.items():
            solver.set_torque_limit(name, most)
        self.start_com = robot.com_world().copy()
        self.start_trunk = robot.get_T_world_frame(job.trunk)[:3, :3].copy()
        for foot, corners in zip(job.feet, job.corners, strict=True):
            self.hold(foot, np.array(corners))
        # PlaCo weighs squares, the others rows before squaring.
        self.com_task = self.driven(solver.add_com_task(self.start_com), "com", 100.0)
        turn = solver.add_orientation_task(job.trunk, self.start_trunk)
        self.trunk = self.driven(turn, "trunk", 1.0)
        posture = solver.add_joints_task()
        posture.set_joints(job.joints)
        self.driven(posture, "posture", 0.01)
        self.most = np.array([job.velocities[name] for name in robot.joint_names()])
        self.at = [robot.get_joint_v_offset(name) for name in robot.joint_names()]

    def driven(self, task, name, weight):
        task.configure(name, "soft", weight)
        task.kp, task.kd = KP, 2.0 * np.sqrt(KP)
        return task

    def hold(self, foot, corners):
        """Hold a foot; its sole is a rectangle about a point, in its axes."""
        solver, middle = self.solver, 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        held = solver.add_frame_task(foot, self.robot.get_T_world_frame(foot))
        for part in (held.position(), held.orientation()):
            part.kp, part.kd = KP, 2.0 * np.sqrt(KP)
        held.configure(foot, "hard", 1.0, 1.0)
        contact = solver.add_planar_contact(held)
        # Its rectangle is about the frame's origin: half as long as to the nearer end.
        size = 2.0 * (np.ptp(corners, axis=0) / 2.0 - np.abs(middle))
        contact.length, contact.width, contact.mu = float(size[0]), float(size[1]), 0.6
        contact.weight_forces = contact.weight_moments = 1e-6

    def speed(self):
        return float(np.max(np.abs(np.array(self.robot.state.qd)[self.at]) / self.most))


if __name__ == "__main__":
    serve(Loop, {name: version(name) for name in ("placo", "pin")})
