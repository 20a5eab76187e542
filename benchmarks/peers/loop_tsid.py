"""Torques with TSID: python loop_tsid.py JOB.json."""

import warnings
from importlib.metadata import version

import numpy as np
import pinocchio as pin
from serve import KP, serve

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of converters that are registered twice
    import tsid

KD = 2.0 * np.sqrt(KP)


class Loop:
    """The robot moves as computed: no physics."""

    def __init__(self, job):
        self.job = job
        self.robot = robot = tsid.RobotWrapper(job.urdf, [], pin.JointModelFreeFlyer(), False)
        model = robot.model()
        self.q, self.v = pin.neutral(model), np.zeros(robot.nv)
        self.q[:7] = job.base
        for name, value in job.joints.items():
            self.q[model.joints[model.getJointId(name)].idx_q] = value
        self.formulation = tsid.InverseDynamicsFormulationAccForce("tsid", robot, False)
        self.formulation.computeProblemData(0.0, self.q, self.v)
        data = self.formulation.data()
        self.ids = [model.getFrameId(foot) for foot in job.feet]
        self.contacts = []
        for foot, corners, frame in zip(job.feet, job.corners, self.ids, strict=True):
            contact = tsid.Contact6d(
                foot, robot, foot, np.array(corners).T, np.array([0.0, 0.0, 1.0]), 0.6, 0.0, 1e4
            )
            contact.setKp(KP * np.ones(6))
            contact.setKd(KD * np.ones(6))
            contact.setReference(robot.framePosition(data, frame))
            self.formulation.addRigidContact(contact, 1e-6)
            self.contacts.append(contact)
        # TSID weighs squares, the others rows before squaring.
        self.start_com = robot.com(data).copy()
        self.com_task = self.task(tsid.TaskComEquality("com", robot), 3, 100.0)
        self.com_sample = tsid.TrajectoryEuclidianConstant("com", self.start_com).computeNext()
        trunk = tsid.TaskSE3Equality("trunk", robot, job.trunk)
        trunk.setMask(np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]))
        self.trunk = self.task(trunk, 6, 1.0)
        place = robot.framePosition(data, model.getFrameId(job.trunk))
        self.start_trunk, self.place = place.rotation.copy(), place.translation.copy()
        posture = self.task(tsid.TaskJointPosture("posture", robot), robot.na, 0.01)
        posture.setReference(tsid.TrajectoryEuclidianConstant("q", self.q[7:]).computeNext())
        self.posture = posture
        limits = tsid.TaskActuationBounds("torques", robot)
        most = np.array([job.efforts[name] for name in list(model.names)[2:]])
        limits.setBounds(-most, most)
        self.formulation.addActuationTask(limits, 1.0, 0, 0.0)
        self.limits = limits
        self.solver = tsid.SolverHQuadProgFast("qp")
        f = self.formulation
        self.solver.resize(f.nVar, f.nEq, f.nIn)
        self.most = np.array([job.velocities[name] for name in list(model.names)[2:]])

    def task(self, task, size, weight):
        task.setKp(KP * np.ones(size))
        task.setKd(KD * np.ones(size))
        self.formulation.addMotionTask(task, weight, 1, 0.0)
        return task

    def aim(self, com, rotation, k):
        self.time = k * self.job.dt
        self.com_sample.value(com)
        self.com_task.setReference(self.com_sample)
        sample = tsid.TrajectorySample(12, 6)
        sample.value(np.concatenate((self.place, rotation.T.ravel())))
        self.trunk.setReference(sample)

    def tick(self):
        problem = self.formulation.computeProblemData(self.time, self.q, self.v)
        solution = self.solver.solve(problem)
        self.formulation.getActuatorForces(solution)
        self.acceleration = self.formulation.getAccelerations(solution)

    def move(self):
        self.v = self.v + self.job.dt * self.acceleration
        self.q = pin.integrate(self.robot.model(), self.q, self.v * self.job.dt)

    def here(self):
        data = self.robot.model().createData()
        pin.framesForwardKinematics(self.robot.model(), data, self.q)
        return data

    def com(self):
        return pin.centerOfMass(self.robot.model(), self.here(), self.q)

    def feet(self):
        data = self.here()
        return np.array([data.oMf[frame].translation for frame in self.ids])

    def speed(self):
        return float(np.max(np.abs(self.v[6:]) / self.most))


if __name__ == "__main__":
    serve(Loop, {name: version(name) for name in ("tsid", "pin")})
