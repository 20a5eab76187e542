"""The job with Pink: python loop_pink.py JOB.json daqp."""

from importlib.metadata import version

import coal
import numpy as np
import pink
import pinocchio as pin
from pink.barriers import SelfCollisionBarrier
from pink.tasks import ComTask, FrameTask, PostureTask
from serve import serve


class Loop:
    def __init__(self, job, solver):
        self.job, self.solver = job, solver
        model = pin.buildModelFromUrdf(job.urdf, pin.JointModelFreeFlyer())
        q = pin.neutral(model)
        q[:7] = job.base
        for name, value in job.joints.items():
            q[model.joints[model.getJointId(name)].idx_q] = value
        shapes = self.spheres(model) if job.pairs else {}
        self.configuration = pink.Configuration(model, model.createData(), q, **shapes)
        self.barriers = []
        if job.pairs:  # a row for each; without the cost of a way back that barriers add by default
            count = len(job.pairs)
            apart = SelfCollisionBarrier(count, safe_displacement_gain=0.0, d_min=job.margin)
            self.barriers.append(apart)
        self.com_task = ComTask(cost=10.0, gain=1.0)
        self.trunk = FrameTask(job.trunk, position_cost=0.0, orientation_cost=1.0, gain=1.0)
        posture = PostureTask(cost=0.1, gain=1.0)
        self.contacts = [FrameTask(foot, 1.0, 1.0) for foot in job.feet]
        self.tasks = [self.com_task, self.trunk, posture]
        for task in (*self.tasks, *self.contacts):
            task.set_target_from_configuration(self.configuration)
        self.start_com = self.com_task.target_com.copy()
        self.start_trunk = self.trunk.transform_target_to_world.rotation.copy()
        self.v = np.zeros(model.nv)
        self.limits = model.velocityLimit[6:]

    def spheres(self, model):
        """Return the shapes and their pairs as a configuration takes them."""
        shapes = pin.GeometryModel()
        for link in self.job.balls:
            index = model.getFrameId(link)
            frame = model.frames[index]
            ball = coal.Sphere(self.job.radius)
            shapes.addGeometryObject(
                pin.GeometryObject(link, frame.parentJoint, index, frame.placement, ball)
            )
        for pair in self.job.pairs:
            shapes.addCollisionPair(pin.CollisionPair(*map(shapes.getGeometryId, pair)))
        return {"collision_model": shapes, "collision_data": pin.GeometryData(shapes)}

    def aim(self, com, rotation, k):
        self.com_task.set_target(com)
        target = self.trunk.transform_target_to_world
        self.trunk.set_target(pin.SE3(rotation, target.translation))

    def tick(self):
        self.v = pink.solve_ik(
            self.configuration,
            self.tasks,
            self.job.dt,
            self.solver,
            constraints=self.contacts,
            barriers=self.barriers,
        )
        self.configuration.integrate_inplace(self.v, self.job.dt)  # and the kinematics there

    def move(self):
        pass

    def com(self):
        return pin.centerOfMass(
            self.configuration.model, self.configuration.data, self.configuration.q
        )

    def feet(self):
        place = self.configuration.get_transform_frame_to_world
        return np.array([place(foot).translation for foot in self.job.feet])

    def links(self, names):
        place = self.configuration.get_transform_frame_to_world
        return np.array([place(name).translation for name in names])

    def speed(self):
        return float(np.max(np.abs(self.v[6:]) / self.limits))


if __name__ == "__main__":
    names = ("pin-pink", "pin", "qpsolvers", "daqp", "proxsuite")
    serve(Loop, {name: version(name) for name in names})
