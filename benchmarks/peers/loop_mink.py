"""The job with mink: python loop_mink.py JOB.json daqp."""

from importlib.metadata import version

import mink
import mujoco
import numpy as np
from serve import serve


class Loop:
    def __init__(self, job, solver):
        self.job, self.solver = job, solver
        self.model = model = mujoco.MjModel.from_xml_path(job.mjcf)
        q = np.zeros(model.nq)
        x, y, z, w = job.base[3:]
        q[:7] = (*job.base[:3], w, x, y, z)
        for name, value in job.joints.items():
            q[model.joint(name).qposadr[0]] = value
        self.configuration = mink.Configuration(model, q)
        self.com_task = mink.ComTask(cost=10.0, gain=1.0)
        self.trunk = mink.FrameTask(
            job.trunk, "body", position_cost=0.0, orientation_cost=1.0, gain=1.0
        )
        posture = mink.PostureTask(model, cost=0.1, gain=1.0)
        self.contacts = [mink.FrameTask(foot, "body", 1.0, 1.0) for foot in job.feet]
        self.tasks = [self.com_task, self.trunk, posture]
        for task in (*self.tasks, *self.contacts):
            task.set_target_from_configuration(self.configuration)
        self.limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, job.velocities)]
        if job.pairs:
            pairs = [([f"{a}_ball"], [f"{b}_ball"]) for a, b in job.pairs]
            # Detected at any distance: a row for each pair, as the others have it.
            apart = mink.CollisionAvoidanceLimit(
                model,
                pairs,
                gain=0.5,
                minimum_distance_from_collisions=job.margin,
                collision_detection_distance=2.0,
            )
            self.limits.append(apart)
        self.start_com = self.com_task.target_com.copy()
        self.start_trunk = self.trunk.transform_target_to_world.rotation().as_matrix().copy()
        self.place = self.trunk.transform_target_to_world.translation().copy()
        self.v = np.zeros(model.nv)
        self.order = [model.joint(name).dofadr[0] for name in job.velocities]
        self.most = np.array(list(job.velocities.values()))

    def aim(self, com, rotation, k):
        self.com_task.set_target(com)
        turned = mink.SO3.from_matrix(rotation)
        self.trunk.set_target(mink.SE3.from_rotation_and_translation(turned, self.place))

    def tick(self):
        self.v = mink.solve_ik(
            self.configuration,
            self.tasks,
            self.job.dt,
            self.solver,
            limits=self.limits,
            constraints=self.contacts,
        )
        self.configuration.integrate_inplace(self.v, self.job.dt)  # and the kinematics there

    def move(self):
        pass

    def com(self):
        return self.configuration.data.subtree_com[1].copy()

    def feet(self):
        return np.array([self.configuration.data.body(foot).xpos for foot in self.job.feet])

    def links(self, names):
        return np.array([self.configuration.data.body(name).xpos for name in names])

    def speed(self):
        return float(np.max(np.abs(self.v[self.order]) / self.most))


if __name__ == "__main__":
    names = ("mink", "mujoco", "qpsolvers", "daqp", "proxsuite")
    serve(Loop, {name: version(name) for name in names})
