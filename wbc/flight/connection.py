"""The mechanical connection: the base's rotation by joint motion, without contacts and momentum.

The angular momentum about the CoM is k = I w + K(q) q', in base axes, w the base's angular
velocity, I the CRB inertia and K q' the momentum of the joints' motion alone. Without momentum
w = -I^-1 K q': the mechanical connection. It depends on the joints only, and so does the rotation
by a closed path of the joints (its holonomy), at any speed.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from wbc.flight.rounds import JointLoop, even_phases
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.symbolic import ROOT, LocalRobot, angle_turns
from wbc.rotations import exp_rotation
from wbc.validate import Array


def turning_rate(robot: Robot) -> ca.Function:
    """Return the function (joints, joint rates) -> w of a robot without momentum.

    From joints (nv-6, 1) [rad or m] and their rates to the base's angular velocity (3, 1) in base
    axes [rad/s]; rates may be derivatives by any parameter of a path, w is by the same.
    """
    model, count = robot.model, robot.nv - BASE_NV
    q, rates = ca.SX.sym("q", count), ca.SX.sym("rates", count)
    local = LocalRobot(robot, angle_turns(robot, q))
    momentum = ca.SX.zeros(3)
    angular = {ROOT: ca.SX.zeros(3)}
    for joint in range(ROOT, model.njoints):
        place, inertia = local.joint(joint), model.inertias[joint]
        if joint != ROOT:
            axis = np.array(model.joints[joint].createData().S, dtype=float).reshape(6)[3:]
            rate = rates[model.idx_vs[joint] - BASE_NV]
            angular[joint] = angular[model.parents[joint]] + ca.mtimes(place.rotation, axis) * rate
        com = place.position + ca.mtimes(place.rotation, np.array(inertia.lever))
        velocity = ca.jtimes(com, q, rates)
        rotated = ca.mtimes(place.rotation, ca.DM(np.array(inertia.inertia)))
        momentum += inertia.mass * ca.cross(com - local.com, velocity)
        momentum += ca.mtimes(rotated, ca.mtimes(place.rotation.T, angular[joint]))
    w = -ca.solve(local.inertia, momentum)
    return ca.Function("turning_rate", [q, rates], [w], ["q", "rates"], ["w"])


def rotation_of(rate: ca.Function, loop: JointLoop, count: int) -> Array:
    """Return the base's rotation (3, 3) by one round of a path: a product of ``count`` steps.

    From the base's axes after the round to those before. ``rate`` is that of :func:`turning_rate`.
    """
    phases = even_phases(count)
    w = np.array(rate.map(count)(loop.at(phases).T, loop.at(phases, 1).T))
    R = np.eye(3)
    for step in 2.0 * np.pi / count * w.T:
        R = R @ exp_rotation(step)
    return R
