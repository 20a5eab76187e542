"""How a robot that nothing holds must turn while its joints move, if it has no momentum.

The angular momentum about the CoM is k = I w + K(q) q', in base axes, w the base's angular
velocity, I the CRB inertia and K q' the momentum of the joints' motion alone. Without momentum
w = -I^-1 K q': the mechanical connection. It depends on the joints only, and so does the rotation
that a closed path of the joints leaves behind, however fast it is gone through.
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

    Joints (nv-6, 1) [rad or m] and their rates to the base's angular velocity (3, 1) in base axes
    [rad/s]; with rates by any other parameter of a path, w is by that parameter, too.
    """
    model, count = robot.model, robot.nv - BASE_NV
    q, rates = ca.SX.sym("q", count), ca.SX.sym("rates", count)
    local = LocalRobot(robot, angle_turns(robot, q))
    momentum = ca.SX.zeros(3)
    spins = {ROOT: ca.SX.zeros(3)}
    for joint in range(ROOT, model.njoints):
        place, inertia = local.joint(joint), model.inertias[joint]
        if joint != ROOT:
            axis = np.array(model.joints[joint].createData().S, dtype=float).reshape(6)[3:]
            rate = rates[model.idx_vs[joint] - BASE_NV]
            spins[joint] = spins[model.parents[joint]] + ca.mtimes(place.rotation, axis) * rate
        com = place.position + ca.mtimes(place.rotation, np.array(inertia.lever))
        speed = ca.jtimes(com, q, rates)
        turned = ca.mtimes(place.rotation, ca.DM(np.array(inertia.inertia)))
        momentum += inertia.mass * ca.cross(com - local.com, speed)
        momentum += ca.mtimes(turned, ca.mtimes(place.rotation.T, spins[joint]))
    w = -ca.solve(local.inertia, momentum)
    return ca.Function("turning_rate", [q, rates], [w], ["q", "rates"], ["w"])


def rotation_of(rate: ca.Function, loop: JointLoop, count: int) -> Array:
    """Return the rotation (3, 3) that one round leaves behind: a product of ``count`` steps.

    From the base's axes after the round to those before. ``rate`` is that of :func:`turning_rate`.
    """
    phases = even_phases(count)
    w = np.array(rate.map(count)(loop.at(phases).T, loop.at(phases, 1).T))
    R = np.eye(3)
    for step in 2.0 * np.pi / count * w.T:
        R = R @ exp_rotation(step)
    return R
