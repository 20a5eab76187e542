"""Strict priorities: a level may only use the freedom that the levels above it leave.

Level by level a QP is solved; what it achieved for its tasks, ``W J x*``, becomes equality rows for
the next one (lexicographic optimisation, as Kanoun, Lamiraux and Wieber 2011). Limits and contacts
hold on every level, so a lower one can always do what the higher one did: no level is infeasible.
The kept rows repeat each other and the contacts more often than not, hence below the first level
the equalities are eliminated by a rank-revealing factorisation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.constraints.contact import Contact
from wbc.laws import Rows
from wbc.qp.problem import Labels
from wbc.tasks.task import Task
from wbc.validate import Array


def grouped(tasks: Sequence[Task]) -> tuple[tuple[int, ...], ...]:
    """Return the indices of the tasks of each level, the most important level first."""
    priorities = sorted({task.priority for task in tasks})
    return tuple(
        tuple(k for k, task in enumerate(tasks) if task.priority == priority)
        for priority in priorities
    )


def kept(rows: Sequence[Rows], x: Array) -> list[Rows]:
    """Return equality rows that keep what ``x`` achieves for ``rows``; weightless rows are free."""
    held = []
    for row in rows:
        wanted = row.weight > 0.0
        matrix = row.matrix[wanted]
        held.append(Rows(matrix, matrix @ x[: matrix.shape[1]], np.ones(len(matrix))))
    return held


def level_labels(first: Labels, above: Sequence[Task | Contact]) -> Labels:
    """Return the labels of a level's QP: the contacts', then the kept rows of what is above."""
    names = tuple(
        f"{part.name} {row}"
        for part in above
        for row, weight in zip(part.rows, part.weight, strict=True)
        if weight > 0.0
    )
    return Labels(first.equality + names, first.inequality, first.variables)
