"""The duration of a lean with the CoM beyond the feet, against the pendulum's static lean.

The robot begins at rest, its CoM ahead of its toes. Growing angular momentum holds it there: k' = M
g e, e the distance from the toes (paper 4.2). The prediction is that of
`wbc.rmp.balance.static_lean`, whose wheel has the robot's inertia and its range of rotation about
the CoM: until, moved at 1 rad/s at the velocity level with the CoM at rest, joints and margins
leave less than 90 % of that rate. The simulated lean ends when the CoM is 5 mm off.

Soles end in corners of different length, and compliant ground shares the load among all that are
near: the CoP settles some millimetres behind the foremost. A controller that shares it too
(``force_damping``) also moves it there: a hundredth of the default leaves 1 mm of 4. So there are
two predictions: from the sole's foremost edge, and from the true CoP at the start of the lean.

    python benchmarks/lean.py [--robots g1] [--beyond 0.01 0.02 0.03 0.04]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse

import numpy as np

import wbc
from wbc.constraints.com_support import support_polygon
from wbc.controllers.closed_loop import closed_loop
from wbc.laws import AccelerationLaw
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.static_lean import StaticLean
from wbc.rmp.planar import PlanarRmp
from wbc.simulation import Plant
from wbc.validate import Array

FEET = ("left", "right")
RATE = 1.0  # rad/s of the rotation about the CoM that measures its range
SHORT = 0.9  # fraction of it below which the robot is at its limits
BEGIN = (0.1, 0.3)  # s, between the settling of the contacts and the end of the shortest lean
HELD = 5e-3  # m that the CoM may be off
UNSHARED = 1e-4  # of the controller's forces: its CoP goes as far ahead as it can
DEEPER = 0.06  # m below the standing CoM: straight knees leave no range of rotation
# The capsule around the G1's pelvis is wider than the pelvis: thighs overlap it in every bow.
EXCLUDED = {"g1": [("pelvis_contour_link", "*hip_roll_link")]}


def margins(robot: wbc.Robot, limits: wbc.Limits) -> list[wbc.SelfCollision]:
    """Return the self-collision margins."""
    excluded = EXCLUDED.get(robot.name, [])
    return [wbc.SelfCollision(robot, margin=0.005, exclude=excluded, limits=limits)]


def leaning(robot: wbc.Robot, beyond: float) -> Array:
    """Return a posture (nq,) with the CoM ``beyond`` the toes [m], trunk upright."""
    q = robot.posture("standing")
    start, dt = robot.snapshot(q), 0.01
    x = support_polygon(start, FEET)[:, 0].max() + beyond
    tasks = [
        wbc.ComTask(robot, (x, *(start.com[1:] - (0.0, DEEPER))), gain=0.1, weight=(30, 30, 10)),
        wbc.OrientationTask(robot, "base", np.eye(3), weight=30.0),
        wbc.PostureTask(robot, q, weight=0.3),
    ]
    contacts, limits = wbc.support(start, "double"), wbc.Limits(robot)
    controller = wbc.KinematicController(robot, tasks, contacts=contacts, limits=limits, dt=dt)
    *_, last = closed_loop(controller, q, 500)
    return last.q


def range_of_turn(robot: wbc.Robot, q: Array) -> float:
    """Return the robot's range of forward rotation about its CoM at rest [rad]."""
    start, dt = robot.snapshot(q), 0.005
    limits = wbc.Limits(robot)
    spin = wbc.MomentumTask(robot, components=("kx", "ky", "kz"), weight=10.0)
    controller = wbc.KinematicController(
        robot,
        [
            wbc.ComTask(robot, start.com, gain=0.1, weight=300.0),
            spin,
            wbc.PostureTask(robot, q, weight=0.1, gain=1e-3),
        ],
        contacts=wbc.support(start, "double"),
        limits=limits,
        constraints=margins(robot, limits),
        dt=dt,
    )
    v, turned, begun = None, 0.0, False
    for _ in range(2000):
        here = robot.snapshot(q, v)
        spin.set_target((0, 0, 0, 0, RATE * here.inertia[1, 1], 0))
        v = controller.step(here).velocity
        rate = robot.snapshot(q, v).momentum[4] / here.inertia[1, 1]
        begun |= rate >= SHORT * RATE  # joints speed up first, no faster than they may
        if begun and rate < SHORT * RATE:
            break
        turned += rate * dt
        q = robot.integrate(q, v, dt)
    return turned


def predicted(robot: wbc.Robot, q: Array, angle: float, beyond: float) -> float:
    """Return the duration of the pendulum's lean [s], its CoM ``beyond`` its foot [m].

    Its wheel is free to turn by ``angle`` [rad].
    """
    start = robot.snapshot(q)
    leg = np.hypot(beyond, start.com[2])
    theta, radius = np.arccos(beyond / leg), np.sqrt(start.inertia[1, 1] / robot.mass)
    law = StaticLean(PlanarRmp(robot.mass), theta, leg, radius, LawBounds(wheel_angle=angle))
    return law.time_left((0.0, theta, leg, 0.0, radius), np.zeros(5))


def held(robot: wbc.Robot, q: Array) -> tuple[float, float]:
    """Return the duration of the simulated lean [s], and the CoM's distance beyond the CoP [m].

    The latter is the mean while the lean begins [m].
    """
    start, dt = robot.snapshot(q), 0.002
    law = AccelerationLaw.capture_point(float(start.com[2]), 3.0)
    limits = wbc.Limits(robot)
    controller = wbc.TorqueController(
        robot,
        [
            wbc.ComTask(robot, start.com, axes=("x", "y"), kp=law.kp, kd=law.kd, weight=30.0),
            wbc.ComTask(robot, start.com, axes=("z",), kp=100.0, weight=15.0, name="height"),
            wbc.MomentumTask(robot, components=("kx", "kz"), weight=0.4),
            wbc.PostureTask(robot, q, kp=1.0, weight=0.02),
        ],
        contacts=wbc.support(start, "double"),
        limits=limits,
        constraints=margins(robot, limits),
        solver="active_set",
        dt=dt,
        force_damping=UNSHARED,
    )
    plant = Plant(robot, dt=dt)
    plant.reset(q)
    arms = []
    while np.linalg.norm(plant.com - start.com) < HELD and plant.time < 10.0:
        plant.step(controller.step(plant.snapshot()).torque)
        if BEGIN[0] < plant.time < BEGIN[1] and plant.cop is not None:
            arms.append(plant.com[0] - plant.cop[0])
    return plant.time, float(np.mean(arms))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="+", default=["g1", "talos"])
    parser.add_argument("--beyond", type=float, nargs="+", default=[0.01, 0.02, 0.03, 0.04])
    given = parser.parse_args()
    for name in given.robots:
        robot = wbc.Robot.load(name, armature=0.003)
        for beyond in given.beyond:
            q = leaning(robot, beyond)
            angle = range_of_turn(robot, q)
            found, arm = held(robot, q)
            edge, real = (predicted(robot, q, angle, by) for by in (beyond, arm))
            print(
                f"{name:8} CoM {1e3 * beyond:3.0f} mm beyond the toes, {1e3 * arm:4.1f} beyond the"
                f" CoP: turns by {angle:.2f} rad, held for {found:.3f} s; predicted"
                f" {edge:.3f} s from the edge ({found / edge - 1.0:+.1%}),"
                f" {real:.3f} s from the CoP ({found / real - 1.0:+.1%})",
                flush=True,
            )
