"""Finish an answer that is nearly right: settle which bounds are active, then solve exactly.

ProxQP can stop with a tiny multiplier of the wrong sign at a bound that is not active; to its own
tests that looks solved. Given such a start, a few primal-dual active set steps (Hintermueller, Ito
and Kunisch 2002; a semismooth Newton method) find the active set, and with it the optimum to
rounding. Each step solves one linear system, so this runs only when an answer was rejected.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wbc.qp.answer import Answer
from wbc.qp.problem import QP
from wbc.validate import Array

STEPS = 15
ROOM = 1e-11  # more than rounding leaves at a bound that is met exactly


def polish(qp: QP, answer: Answer) -> Answer:
    """Return ``answer`` with its active set settled, or unchanged if the steps do not settle."""
    rows, lower, upper = _all_rows(qp)
    x, y, multipliers = answer.x, answer.y, np.concatenate((answer.z_box, answer.z))
    if not (np.isfinite(x).all() and np.isfinite(multipliers).all()):
        return answer
    before = np.full(lower.size, np.nan)
    for _ in range(STEPS):
        value = rows @ x
        # A bound counts as active where its multiplier outweighs the distance left to it.
        active = np.where(multipliers > upper - value, 1.0, 0.0)
        active -= np.where(multipliers < lower - value, 1.0, 0.0)
        if np.array_equal(active, before):
            n = qp.g.size
            return replace(answer, x=x, y=y, z=multipliers[n:], z_box=multipliers[:n])
        before = active
        held = np.flatnonzero(active)
        bound = np.where(active[held] > 0, upper[held], lower[held])
        x, y, at_bounds = _solve_equalities(qp, rows[held], bound)
        # Bounds that depend on each other and do not quite agree are shared out by least squares:
        # one is exceeded a little, another not reached. The one not reached is not active.
        room = active[held] * (bound - rows[held] @ x)
        at_bounds[room > ROOM] = 0.0
        multipliers = np.zeros(lower.size)
        multipliers[held] = at_bounds
    return answer


def _all_rows(qp: QP) -> tuple[Array, Array, Array]:
    """Return bounds and inequalities as one set of rows (n + mi, n) with two sides."""
    rows = np.concatenate((np.eye(qp.g.size), qp.C))
    return rows, np.concatenate((qp.lower, qp.l)), np.concatenate((qp.upper, qp.u))


def _solve_equalities(qp: QP, held: Array, bound: Array) -> tuple[Array, Array, Array]:
    """Return x, y and the multipliers of ``held @ x = bound`` at the optimum with only those rows.

    Least squares, because held rows may repeat each other.
    """
    n, me = qp.g.size, qp.b.size
    tied = np.concatenate((qp.A, held))
    system = np.zeros((n + len(tied), n + len(tied)))
    system[:n, :n] = qp.P
    system[:n, n:] = tied.T
    system[n:, :n] = tied
    right = np.concatenate((-qp.g, qp.b, bound))
    solved = np.linalg.lstsq(system, right, rcond=1e-15)[0]
    return solved[:n], solved[n : n + me], solved[n + me :]
