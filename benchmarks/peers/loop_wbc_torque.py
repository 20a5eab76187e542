"""Torques with this package: python loop_wbc_torque.py JOB.json active_set [inertia]."""

from loop_wbc import Loop as VelocityLoop
from serve import KP, serve

import wbc
from wbc.problem.provenance import versions


class Loop(VelocityLoop):
    """The robot moves as computed: no physics."""

    def make(self, start, solver, inertia):
        robot, job = self.robot, self.job
        self.com_task = wbc.ComTask(robot, start.com, weight=10.0, kp=KP)
        self.trunk = wbc.OrientationTask(robot, job.trunk, self.start_trunk, weight=1.0, kp=KP)
        posture = wbc.PostureTask(robot, self.q, weight=0.1, kp=KP)
        tasks = [self.com_task, self.trunk, posture]
        if inertia:
            self.inertia = wbc.InertiaTask(robot, start.inertia, per_mass=True, kp=KP)
            tasks.insert(0, self.inertia)
        self.controller = wbc.TorqueController(
            robot,
            tasks,
            contacts=wbc.support(start, "double"),
            limits=None,
            dt=job.dt,
            solver=solver,
        )

    def tick(self):
        tick = self.controller.step(self.robot.snapshot(self.q, self.v))
        self.v, self.torque = tick.velocity, tick.torque


if __name__ == "__main__":
    serve(Loop, versions())
