"""The job with this package: python loop_wbc.py JOB.json active_set [inertia]."""

import numpy as np
from serve import serve

import wbc
from wbc.problem.provenance import versions
from wbc.robot.collision import Body, Capsule, CollisionModel


class Loop:
    def __init__(self, job, solver, inertia=""):
        self.job = job
        self.robot = robot = wbc.Robot.load(job.robot)
        self.q, self.v = robot.posture("standing"), np.zeros(robot.nv)
        start = robot.snapshot(self.q)
        self.start_com, self.start_trunk = start.com.copy(), start.rotation(job.trunk).copy()
        self.start_inertia = start.inertia.copy()
        self.inertia = None
        self.make(start, solver, inertia)
        self.limits = np.array([job.velocities[name] for name in robot.joint_names])

    def make(self, start, solver, inertia):
        """Make tasks and controller."""
        robot, job = self.robot, self.job
        self.com_task = wbc.ComTask(robot, start.com, weight=10.0, gain=1.0)
        self.trunk = wbc.OrientationTask(robot, job.trunk, self.start_trunk, weight=1.0, gain=1.0)
        posture = wbc.PostureTask(robot, self.q, weight=0.1, gain=1.0)
        tasks = [self.com_task, self.trunk, posture]
        if inertia:
            self.inertia = wbc.InertiaTask(robot, start.inertia, per_mass=True, gain=0.2)
            tasks.insert(0, self.inertia)
        limits = wbc.Limits(robot)
        limits.speed = np.array([job.velocities[name] for name in robot.joint_names])
        self.controller = wbc.KinematicController(
            robot,
            tasks,
            contacts=wbc.support(start, "double"),
            limits=limits,
            constraints=self.constraints(),
            dt=job.dt,
            solver=solver,
        )

    def constraints(self):
        """Return what keeps the job's spheres apart."""
        robot, job = self.robot, self.job
        if not job.pairs:
            return []
        bodies = []
        for link in job.balls:
            frame = robot.model.frames[robot.frame_id(link)]
            ball = Capsule.sphere(frame.placement.translation, job.radius)
            bodies.append(Body(link, link, frame.parentJoint, ball))
        pairs = [tuple(map(job.balls.index, pair)) for pair in job.pairs]
        model = CollisionModel(robot, bodies, pairs)
        return [wbc.SelfCollision(robot, model=model, margin=job.margin, pairs=len(pairs))]

    def aim(self, com, rotation, k):
        self.com_task.set_target(com)
        self.trunk.set_target(rotation)
        if self.inertia is not None:
            self.inertia.set_target(
                self.start_inertia * (1 + 0.05 * np.sin(np.pi * k * self.job.dt))
            )

    def tick(self):
        self.v = self.controller.step(self.robot.snapshot(self.q, self.v)).velocity

    def move(self):
        self.q = self.robot.integrate(self.q, self.v, self.job.dt)

    def com(self):
        return self.robot.snapshot(self.q).com

    def feet(self):
        here = self.robot.snapshot(self.q)
        return np.array([here.position(foot) for foot in self.job.feet])

    def links(self, names):
        here = self.robot.snapshot(self.q)
        return np.array([here.position(name) for name in names])

    def speed(self):
        return float(np.max(np.abs(self.v[6:]) / self.limits))


if __name__ == "__main__":
    serve(Loop, versions())
