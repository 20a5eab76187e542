"""Strict priorities: a level may only use the freedom that the levels above it leave.

Level by level a QP is solved; what it achieved for its tasks, ``W J x*``, becomes equality rows for
the next one (lexicographic optimisation, as Kanoun, Lamiraux and Wieber 2011). Limits and contacts
hold on every level, so a lower one can always do what the higher one did: no level is infeasible.
The kept rows repeat each other and the contacts more often than not, hence below the first level
the equalities are eliminated by a rank-revealing factorisation.

Bounds that hold a level back hold on all levels below: while a multiplier is not 0, complementarity
leaves every optimum of its level at that bound. There they are equalities (Escande, Mansard and
Wieber 2014), since between a kept row and the bounds that limit it there is no room, and solvers
need some to work in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints.contact import Contact
from wbc.laws import Rows
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import Solution
from wbc.tasks.task import Task
from wbc.validate import Array

# A bound holds if its multiplier is so many times what damping can explain.
HOLDING = 10.0


class Holding(NamedTuple):
    """Bounds that hold the levels so far.

    Attributes
    ----------
    variables, rows:
        (n,) and (mi,) true where the bound of a variable, or an inequality row, holds.
    x:
        (n,) where they are held: the solution of the last level.
    """

    variables: NDArray[np.bool_]
    rows: NDArray[np.bool_]
    x: Array

    @classmethod
    def at(cls, qp: QP, solution: Solution, nv: int, damping: float) -> Holding:
        """Return the bounds that hold a solved level; rows with a slack of their own do not."""
        x = solution.x
        least = HOLDING * damping * float(np.abs(x[:nv]).max())
        variables, rows = np.abs(solution.z_box) > least, np.abs(solution.z) > least
        variables[nv:] = False
        if x.size > nv:
            rows &= ~qp.C[:, nv:].any(axis=1)
        return cls(variables, rows, x)

    def and_of(self, above: Holding | None) -> Holding:
        """Return these together with those of the levels above."""
        if above is None:
            return self
        return Holding(self.variables | above.variables, self.rows | above.rows, self.x)

    def fasten(self, qp: QP) -> QP:
        """Return the QP of the next level with these bounds as equalities.

        What the level above missed of other rows and bounds by rounding, this one misses too: so
        it can always do what that one did, however little is left free.
        """
        values = qp.C @ self.x
        A = np.concatenate((qp.A, np.eye(qp.g.size)[self.variables], qp.C[self.rows]))
        names = zip((*qp.labels.variables, *qp.labels.inequality), self._all(), strict=True)
        return replace(
            qp,
            A=A,
            b=A @ self.x,
            lower=np.where(self.variables, -np.inf, np.minimum(qp.lower, self.x)),
            upper=np.where(self.variables, np.inf, np.maximum(qp.upper, self.x)),
            l=np.where(self.rows, -np.inf, np.minimum(qp.l, values)),
            u=np.where(self.rows, np.inf, np.maximum(qp.u, values)),
            labels=replace(
                qp.labels,
                equality=qp.labels.equality + tuple(name for name, holds in names if holds),
            ),
        )

    def _all(self) -> list[bool]:
        return [*self.variables.tolist(), *self.rows.tolist()]


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
