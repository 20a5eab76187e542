"""Finish a solution that is nearly right: settle which bounds are active, then solve exactly.

ProxQP can stop with a tiny multiplier of the wrong sign at a bound that is not active; to its own
tests that looks solved. From such a start a few steps of the primal-dual active set method
(Hintermueller, Ito and Kunisch 2002; a semismooth Newton method) find the active set, and with it
the optimum to rounding. Each step solves one linear system: only for rejected solutions.
"""

from __future__ import annotations

import numpy as np
from scipy import linalg

from wbc.qp.problem import QP
from wbc.qp.solution import RawSolution
from wbc.validate import Array

STEPS = 3  # those that settle take 1 or 2; 210 that did not in 3 did not in 8
SLACK = 1e-11  # more than rounding leaves at a bound that is met exactly


def polish(qp: QP, raw: RawSolution) -> RawSolution:
    """Return ``raw`` with its active set settled, or unchanged if the steps do not settle."""
    n = qp.g.size
    rows = np.concatenate((np.eye(n), qp.C))  # (n + mi, n): bounds, then inequality rows
    lower, upper = np.concatenate((qp.lower, qp.l)), np.concatenate((qp.upper, qp.u))
    x, y, multipliers = raw.x, raw.y, np.concatenate((raw.z_box, raw.z))
    if not (np.isfinite(x).all() and np.isfinite(multipliers).all()):
        return raw
    before = np.full(lower.size, np.nan)
    for _ in range(STEPS):
        value = rows @ x
        # A bound counts as active where its multiplier outweighs the distance left to it.
        active = np.where(multipliers > upper - value, 1.0, 0.0)
        active -= np.where(multipliers < lower - value, 1.0, 0.0)
        if np.array_equal(active, before):
            return raw._replace(x=x, y=y, z=multipliers[n:], z_box=multipliers[:n])
        before = active
        held = np.flatnonzero(active)
        bound = np.where(active[held] > 0, upper[held], lower[held])
        x, y, at_bounds = _solve_equalities(qp, rows[held], bound)
        # Bounds that depend on each other and do not quite agree are met by least squares: one is
        # exceeded a little, another not reached. The one not reached is not active.
        slack = active[held] * (bound - rows[held] @ x)
        at_bounds[slack > SLACK] = 0.0
        multipliers = np.zeros(lower.size)
        multipliers[held] = at_bounds
    return raw


def _solve_equalities(qp: QP, held: Array, bound: Array) -> tuple[Array, Array, Array]:
    """Return x, y and the multipliers of ``held @ x = bound`` at the optimum with only those rows.

    Least squares, because held rows may repeat each other.
    """
    n, me = qp.g.size, qp.b.size
    equal = np.concatenate((qp.A, held))
    system = np.zeros((n + len(equal), n + len(equal)))
    system[:n, :n] = qp.P
    system[:n, n:] = equal.T
    system[n:, :n] = equal
    right = np.concatenate((-qp.g, qp.b, bound))
    solved = linalg.lstsq(system, right, 1e-15, lapack_driver="gelsy", check_finite=False)[0]
    return solved[:n], solved[n : n + me], solved[n + me :]
