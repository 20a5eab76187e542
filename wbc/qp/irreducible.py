"""From rows that contradict each other to a smallest such set: each of its rows is to blame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from wbc.qp.conflict import REACH, Conflict
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import ConflictRow

# Conflicts of more rows are left as they are: each row costs one more linear program.
MOST_ROWS = 80


def irreducible(qp: QP, conflict: Conflict) -> Conflict:
    """Return a part of ``conflict`` whose rows cannot all hold, but could without any one of them.

    The deletion filter of Chinneck and Dravnieks (1991): rows are left out one by one, the
    lightest first, and stay out if what is left still has no solution, which a linear program
    (HiGHS) decides. About two milliseconds a row: for failed ticks only.

    Parameters
    ----------
    conflict:
        As :func:`wbc.qp.conflict.find_conflict` returns it for ``qp``.

    Returns
    -------
    Conflict
        Rows as they are in ``conflict``, with its multipliers; ``conflict`` itself where it has
        more than ``MOST_ROWS`` rows, or its own rows alone are no contradiction to the linear
        program (a conflict of the order of its accuracy, 1e-7).
    """
    if len(conflict.rows) > MOST_ROWS or _feasible(_only(qp, conflict.rows)):
        return conflict
    kept = list(conflict.rows)
    for row in reversed(conflict.rows):
        without = [other for other in kept if other is not row]
        if not _feasible(_only(qp, without)):
            kept = without
    return Conflict(tuple(kept))


def _feasible(qp: QP) -> bool:
    """Whether any x within reach meets every row, scaled to unit length, and bound."""
    upper, lower = np.isfinite(qp.u), np.isfinite(qp.l)
    length = np.linalg.norm(qp.C, axis=1)
    length[length == 0.0] = 1.0
    C, u, l = qp.C / length[:, None], qp.u / length, qp.l / length  # noqa: E741
    across = np.linalg.norm(qp.A, axis=1)
    across[across == 0.0] = 1.0
    answer = linprog(
        np.zeros(qp.g.size),
        A_ub=np.concatenate((C[upper], -C[lower])),
        b_ub=np.concatenate((u[upper], -l[lower])),
        A_eq=qp.A / across[:, None],
        b_eq=qp.b / across,
        bounds=np.column_stack((np.maximum(qp.lower, -REACH), np.minimum(qp.upper, REACH))),
    )
    return bool(answer.status == 0)


def _only(qp: QP, rows: Sequence[ConflictRow]) -> QP:
    """Return ``qp`` with nothing but the given rows, sides of rows and bounds."""
    equality = _members(qp.labels.equality, rows, ("equality",))
    low = _members(qp.labels.inequality, rows, ("lower limit", "crossed limits"))
    high = _members(qp.labels.inequality, rows, ("upper limit", "crossed limits"))
    lower = _members(qp.labels.variables, rows, ("lower bound", "crossed limits"))
    upper = _members(qp.labels.variables, rows, ("upper bound", "crossed limits"))
    some = low | high
    return replace(
        qp,
        A=qp.A[equality],
        b=qp.b[equality],
        C=qp.C[some],
        l=np.where(low, qp.l, -np.inf)[some],
        u=np.where(high, qp.u, np.inf)[some],
        lower=np.where(lower, qp.lower, -np.inf),
        upper=np.where(upper, qp.upper, np.inf),
        labels=Labels(
            tuple(np.array(qp.labels.equality, dtype=object)[equality]),
            tuple(np.array(qp.labels.inequality, dtype=object)[some]),
            qp.labels.variables,
        ),
    )


def _members(
    names: tuple[str, ...], rows: Sequence[ConflictRow], sides: tuple[str, ...]
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    wanted = {row.label for row in rows if row.side in sides}
    return np.fromiter((name in wanted for name in names), dtype=bool, count=len(names))
