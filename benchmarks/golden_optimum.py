"""The distance of a tick's answer from the optimum of the QP that it claims to have solved.

Solvers stop at residuals that are small, not zero: ProxQP's and DAQP's answers to one QP differ by
1e-9 to 1e-5 in velocities and torques. The optima of the posed QPs can be compared more closely.
"""

from typing import Any

import numpy as np
from scipy.optimize import nnls

import wbc
from wbc.controllers import Controller
from wbc.validate import Array

STEPS, REFINEMENTS = 6, 2
TIGHT = 1e-8  # a bound nearer than this may be active
SLACK = 1e-9  # beyond a bound by more, it is not the optimum
PULL = 1e-7  # of the gradient, by its largest entry: what multipliers may leave


def optimum(qp: Any, solution: Any) -> Array | None:
    """Return the optimum (n,) by active-set steps from an answer; None: not found in a few.

    Each step solves the KKT system of the active set, refined by residuals in extended precision.
    Multipliers are then those of least squares that pull the right way: bounds that depend on each
    other, such as the facets of a friction cone without force, have many.
    """
    n = qp.g.size
    finite = np.isfinite(np.concatenate((qp.u, qp.upper, qp.l, qp.lower)))
    rows = np.concatenate((qp.C, np.eye(n)))
    rows = np.concatenate((rows, -rows))[finite]  # rows x <= most
    most = np.concatenate((qp.u, qp.upper, -qp.l, -qp.lower))[finite]
    pull = np.concatenate((solution.z, solution.z_box))
    x, active = solution.x, np.concatenate((pull, -pull))[finite] > 0.0
    active &= np.concatenate((pull, -pull))[finite] > most - rows @ x
    free = _null_space(qp.A)
    for _ in range(STEPS):
        x = _equality_constrained(qp, rows[active], most[active])
        left = most - rows @ x
        tight = np.flatnonzero(left < TIGHT)
        gradient = qp.P @ x + qp.g
        z, rest = nnls((rows[tight] @ free).T, -(gradient @ free)) if tight.size else ([], 0.0)
        if not tight.size:
            rest = float(np.linalg.norm(gradient @ free))
        if left.min(initial=0.0) >= -SLACK and rest <= PULL * max(1.0, np.abs(qp.g).max()):
            return x
        active = left < -SLACK
        active[tight[np.asarray(z) > 0.0]] = True
    return None


def _null_space(A: Array) -> Array:
    """Return an orthonormal basis (n, free) of what equality rows leave."""
    if not A.size:
        return np.eye(A.shape[1])
    _, values, basis = np.linalg.svd(A)
    return basis[np.count_nonzero(values > 1e-10 * values[0]) :].T


def _equality_constrained(qp: Any, held: Array, met: Array) -> Array:
    matrix = np.concatenate((qp.A, held))
    system = np.block([[qp.P, matrix.T], [matrix, np.zeros((len(matrix),) * 2)]])
    wanted = np.concatenate((-qp.g, qp.b, met))
    inverse = np.linalg.pinv(system, 1e-14)
    found = inverse @ wanted
    for _ in range(REFINEMENTS):
        missed = wanted.astype(np.longdouble) - system @ found.astype(np.longdouble)
        found = found + inverse @ missed.astype(float)
    return found[: qp.g.size]


def exact_answer(
    controller: Controller, q: Array, v: Array, tick: wbc.Tick
) -> dict[str, Array] | None:
    """Return the velocity, and torque, at the optimum of a tick's QP; None: not found."""
    if not tick.ok:
        return None
    x = optimum(tick.qp, tick.solution)
    if x is None:
        return None
    change, robot = x - tick.solution.x, controller.robot
    nv = robot.nv
    found = {"velocity": tick.velocity + tick.step_scale * change[:nv]}
    if isinstance(tick, wbc.TorqueTick):
        here, forces = robot.snapshot(q, v), controller.contact_forces
        pushed = forces.generalized(here) @ change[nv : nv + forces.size] * forces.unit
        turned = here.mass_matrix @ change[:nv] / controller.dt - pushed
        found["torque"] = tick.torque + turned[6:] + robot.damping * change[6:nv]
    return found
