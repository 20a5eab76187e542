"""Conflicts checked by an independent solver, HiGHS."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.linalg import lstsq
from scipy.optimize import linprog

from wbc.qp import QP, Conflict, Labels
from wbc.qp.solution import ConflictRow

# Unknowns without bounds stay within this: as far as conflicts are defined (wbc.qp.conflict).
REACH = 1e6
# Whether a row is needed is no matter of reach: what the others leave may be far away. Nearer it is
# asked for first: HiGHS misses by 1e-7 within 1e8 what it meets to 1e-9 within 1e4.
REACHES = 1e2, 1e4, 1e6, 1e8
ANYWHERE = REACHES[-1]
HELD = 1e-9  # a row of unit length that is missed by less can hold
MET = 1e-12  # of a row, by what it is made of: what rounding leaves


def worst_miss(qp: QP, reach: float = REACH) -> float:
    """Return the least possible maximal violation of the rows, of unit length, within bounds.

    By HiGHS; so no verdict hangs on what it takes for 0. Bounds give way as rows do.

    Raises
    ------
    RuntimeError
        HiGHS finds no answer, by its simplex, its interior-point method, or in coarser steps.
    """
    n = qp.g.size
    rows = np.concatenate((qp.A, qp.C, np.eye(n)))
    lower = np.concatenate((qp.b, qp.l, np.maximum(qp.lower, -reach)))
    upper = np.concatenate((qp.b, qp.u, np.minimum(qp.upper, reach)))
    length = np.linalg.norm(rows, axis=1)
    length[length == 0.0] = 1.0
    rows, lower, upper = rows / length[:, None], lower / length, upper / length
    above, below = np.isfinite(upper), np.isfinite(lower)
    miss = -np.ones((above.sum() + below.sum(), 1))
    fine = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    for method, options in (("highs-ds", fine), ("highs-ipm", fine), ("highs-ds", {})):
        found = linprog(
            np.append(np.zeros(n), 1.0),
            A_ub=np.hstack((np.concatenate((rows[above], -rows[below])), miss)),
            b_ub=np.concatenate((upper[above], -lower[below])),
            bounds=[(None, None)] * n + [(0.0, None)],
            method=method,
            options=options,
        )
        if found.status == 0:
            return float(found.fun)
    raise RuntimeError(found.message)


def can_hold(qp: QP) -> bool:
    """Whether some point satisfies all rows and bounds, to rounding."""
    return worst_miss(qp) <= HELD


def _least_misses(qp: QP, enough: float) -> Iterator[float]:
    """Yield the least violation within growing bounds, until it is small enough."""
    for reach in REACHES:
        miss = worst_miss(qp, reach)
        yield miss
        if miss <= enough:
            return


def has_a_point(qp: QP) -> bool:
    """Whether the least-norm point of all ends of rows and bounds as equalities is feasible.

    Rows without one of them need not be asked of a linear program where this says yes.
    """
    rows, lower, upper = np.concatenate((qp.A, qp.C, np.eye(qp.g.size))), qp.lower, qp.upper
    low, up = np.concatenate((qp.b, qp.l, lower)), np.concatenate((qp.b, qp.u, upper))
    end = np.where(np.isfinite(up), up, low)
    held = np.isfinite(end)
    x = lstsq(rows[held], end[held], 1e-12, lapack_driver="gelsy")[0]  # gelsd may not converge
    miss = np.maximum(low - rows @ x, rows @ x - up)[held]
    size = float(np.abs(x).max())
    rounding = MET * ((1.0 + size) * np.linalg.norm(rows[held], axis=1) + np.abs(end[held]))
    return bool((miss <= rounding).all()) and size < ANYWHERE


def only(qp: QP, rows: list[ConflictRow]) -> QP:
    """Return the QP with only the named sides of rows and bounds."""
    names = qp.labels
    low, up = np.full(qp.u.size, -np.inf), np.full(qp.u.size, np.inf)
    lower, upper = np.full(qp.g.size, -np.inf), np.full(qp.g.size, np.inf)
    equal = np.zeros(qp.b.size, dtype=bool)
    for row in rows:
        if row.side == "equality":
            equal[names.equality.index(row.label)] = True
        elif row.side.endswith("limit"):
            assert row.label in names.inequality
            called = np.array([name == row.label for name in names.inequality])
            end = (up, qp.u) if row.side == "upper limit" else (low, qp.l)
            end[0][called] = end[1][called]
        else:
            k = names.variables.index(row.label)
            end = (upper, qp.upper) if row.side == "upper bound" else (lower, qp.lower)
            end[0][k] = end[1][k]
    left = tuple(name for name, kept in zip(names.equality, equal, strict=True) if kept)
    labels = Labels(left, names.inequality, names.variables)
    return qp._replace(A=qp.A[equal], b=qp.b[equal], l=low, u=up, lower=lower, upper=upper,
                       labels=labels)  # fmt: skip


def conflict_error(qp: QP, conflict: Conflict) -> list[str]:
    """Return the error of a named conflict; nothing if it is one, and needs each of its rows.

    Without a row the others must be met by far better than with it, in rows of unit length.
    """
    rows = list(conflict.rows)
    missed = worst_miss(only(qp, rows))
    if not missed > HELD:
        return [f"they can all hold, to {missed:.1e}"]
    wrong = []
    for k, row in enumerate(rows):
        others = only(qp, rows[:k] + rows[k + 1 :])
        if has_a_point(others):
            continue
        left = min(_least_misses(others, 0.01 * missed + HELD))
        if 0.01 * missed + HELD < left <= 1.01 * missed:  # more is HiGHS' own rounding
            wrong.append(
                f"{row.label!r} ({row.side}) is not needed: missed by {left:.1e} of {missed:.1e}"
            )
    return wrong
