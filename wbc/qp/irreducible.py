"""From rows that contradict each other to a smallest such set: each of its rows is to blame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wbc.qp.conflict import Conflict, find_conflict
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import ConflictRow

# Conflicts of more rows are left as they are: each row costs one more search.
MOST_ROWS = 40


def irreducible(qp: QP, conflict: Conflict, tolerance: float = 1e-7) -> Conflict:
    """Return a part of ``conflict`` whose rows cannot all hold, but could without any one of them.

    The deletion filter of Chinneck and Dravnieks (1991): rows are left out one by one, the
    lightest first, and stay out if what is left still has no solution. Takes some milliseconds a
    row: for failed ticks only.

    Parameters
    ----------
    conflict:
        As :func:`wbc.qp.conflict.find_conflict` returns it for ``qp``.
    tolerance:
        Passed on to it.

    Returns
    -------
    Conflict
        Multipliers and violations are those of the smaller set; ``conflict`` itself where it has
        more than ``MOST_ROWS`` rows or its own rows alone do not prove the contradiction (a very
        small one).
    """
    if len(conflict.rows) > MOST_ROWS:
        return conflict
    kept = list(conflict.rows)
    found = find_conflict(_only(qp, kept), tolerance)
    if found is None:
        return conflict
    for row in reversed(conflict.rows):
        without = [other for other in kept if other is not row]
        smaller = find_conflict(_only(qp, without), tolerance) if without else None
        if smaller is not None:
            kept, found = without, smaller
    return found


def _only(qp: QP, rows: list[ConflictRow]) -> QP:
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
    names: tuple[str, ...], rows: list[ConflictRow], sides: tuple[str, ...]
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    wanted = {row.label for row in rows if row.side in sides}
    return np.fromiter((name in wanted for name in names), dtype=bool, count=len(names))
