"""The job with PlaCo: python loop_placo.py JOB.json."""

import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import placo
from serve import serve


def robot_of(job):
    """Return the robot with the job's pairs of spheres, if it has some, and no other shapes."""
    if not job.pairs:
        return placo.RobotWrapper(job.urdf, placo.Flags.ignore_collisions)
    robot = placo.RobotWrapper(job.urdf)
    file = Path(job.urdf).with_name("pairs.json")
    file.write_text(json.dumps(job.pairs))
    robot.load_collision_pairs(str(file))
    assert len(robot.collision_model.collisionPairs) == len(job.pairs)
    return robot


def started(job):
    """The robot at the job's start."""
    robot = robot_of(job)
    for name, value in job.joints.items():
        robot.set_joint(name, value)
    q = np.array(robot.state.q)
    q[:7] = job.base
    robot.state.q = q
    robot.update_kinematics()
    return robot


class Stepped:
    """Tick and measurements of both levels' loops."""

    def com(self):
        return self.robot.com_world()

    def feet(self):
        return np.array([self.robot.get_T_world_frame(foot)[:3, 3] for foot in self.job.feet])

    def aim(self, com, rotation, k):
        self.com_task.target_world = com
        self.trunk.R_world_frame = rotation

    def tick(self):
        self.solver.solve(True)  # and integrate
        self.robot.update_kinematics()

    def move(self):
        pass


class Loop(Stepped):
    def __init__(self, job):
        self.job = job
        self.robot = robot = started(job)
        self.solver = solver = placo.KinematicsSolver(robot)
        solver.dt = job.dt
        solver.enable_velocity_limits(True)
        solver.enable_joint_limits(True)
        self.start_com = robot.com_world().copy()
        self.start_trunk = robot.get_T_world_frame(job.trunk)[:3, :3].copy()
        # PlaCo weighs squares, the others rows before squaring.
        self.com_task = solver.add_com_task(self.start_com)
        self.com_task.configure("com", "soft", 100.0)
        self.trunk = solver.add_orientation_task(job.trunk, self.start_trunk)
        self.trunk.configure("trunk", "soft", 1.0)
        posture = solver.add_joints_task()
        posture.set_joints(job.joints)
        posture.configure("posture", "soft", 0.01)
        for foot in job.feet:
            held = solver.add_frame_task(foot, robot.get_T_world_frame(foot))
            held.configure(foot, "hard", 1.0, 1.0)
        solver.add_regularization_task(1e-6)
        if job.pairs:
            apart = solver.add_avoid_self_collisions_constraint()
            # Triggered at any distance: a row for each pair, as the others have it.
            apart.self_collisions_margin, apart.self_collisions_trigger = job.margin, 2.0
            apart.configure("apart", "hard")
        self.before = np.array(robot.state.q)
        self.most = np.array([job.velocities[name] for name in robot.joint_names()])
        self.at = [robot.get_joint_offset(name) for name in robot.joint_names()]

    def links(self, names):
        return np.array([self.robot.get_T_world_frame(name)[:3, 3] for name in names])

    def speed(self):
        q = np.array(self.robot.state.q)
        rate = np.abs(q - self.before)[self.at] / self.job.dt
        self.before = q
        return float(np.max(rate / self.most))


if __name__ == "__main__":
    serve(Loop, {name: version(name) for name in ("placo", "pin")})
