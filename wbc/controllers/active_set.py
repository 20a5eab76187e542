"""Active bounds that stay active on the levels below.

Where the rows that a level achieves imply that a bound is met exactly, it is an equality below
(Escande, Mansard and Wieber 2014): between an achieved row and the bounds that limit it there is no
room, and solvers need an interior. Bounds that are active for damping's sake only are not implied;
below they are bounds still.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from wbc.controllers.plan import Decision
from wbc.laws import Rows, stacked
from wbc.qp.elimination import RANK_TOLERANCE, least_squares
from wbc.qp.problem import QP
from wbc.qp.solution import Solution
from wbc.validate import Array

# A bound may be implied if its multiplier is so many times what damping can explain.
CANDIDATE = 10.0
# Multipliers of a certificate below this part of the largest count as 0.
CERTAIN = 1e-6


class ActiveSet(NamedTuple):
    """Bounds that the levels so far force to be met exactly.

    Attributes
    ----------
    variables, rows:
        (n,) and (mi,) true where the bound of a variable, or an inequality row, is met exactly.
    x:
        (n,) where: the solution of the last level.
    """

    variables: NDArray[np.bool_]
    rows: NDArray[np.bool_]
    x: Array

    @classmethod
    def implied(
        cls, qp: QP, solution: Solution, achieved: Sequence[Rows], decision: Decision
    ) -> ActiveSet:
        """Return the active bounds of a level that its achieved rows imply to be equalities.

        A bound is implied by ``A x = b`` and ``J x = J x*`` if multipliers z > 0 of active bounds
        add up to a combination of these rows. Those of the damped QP do but for the damping's
        part; hence they are projected on the multipliers that do, and bounds that are then not
        pulled at are dropped until none is.

        Parameters
        ----------
        decision:
            The unknowns before the slacks; multipliers that their damping explains are left out.
        """
        n, x = decision.size, solution.x
        least = CANDIDATE * float(decision.damping.max()) * float(np.abs(x[:n]).max())
        variables, rows = np.abs(solution.z_box) > least, np.abs(solution.z) > least
        variables[n:] = False
        if x.size > n:  # rows with a slack of their own give way
            rows &= ~qp.C[:, n:].any(axis=1)
        chosen = np.concatenate((np.flatnonzero(variables), x.size + np.flatnonzero(rows)))
        if chosen.size:
            normals = np.concatenate((np.eye(n)[variables[:n]], qp.C[rows, :n]))
            lengths = np.linalg.norm(normals, axis=1)
            pull = np.concatenate((solution.z_box[variables], solution.z[rows]))
            held = stacked([qp.A[:, :n], *(row.matrix for row in achieved)], n)
            signed = (np.copysign(1.0, pull) / lengths)[:, None] * normals
            kept = _positive_kernel(_beside(held, signed), lengths * np.abs(pull))
            dropped = np.delete(chosen, kept)
            variables[dropped[dropped < x.size]] = False
            rows[dropped[dropped >= x.size] - x.size] = False
        return cls(variables, rows, x)

    def union(self, above: ActiveSet | None) -> ActiveSet:
        """Return these together with those of the levels above."""
        if above is None:
            return self
        return ActiveSet(self.variables | above.variables, self.rows | above.rows, self.x)

    def as_equalities(self, qp: QP) -> QP:
        """Return the QP of the next level with these bounds as equalities.

        Other rows and bounds are widened to where the level above violates them by rounding: so
        its solution stays feasible here, however little is left free.
        """
        values = qp.C @ self.x
        A = np.concatenate((qp.A, np.eye(qp.g.size)[self.variables], qp.C[self.rows]))
        every = (*qp.labels.variables, *qp.labels.inequality)
        met = (*self.variables.tolist(), *self.rows.tolist())
        names = tuple(name for name, one in zip(every, met, strict=True) if one)
        return qp._replace(
            A=A,
            b=A @ self.x,
            lower=np.where(self.variables, -np.inf, np.minimum(qp.lower, self.x)),
            upper=np.where(self.variables, np.inf, np.maximum(qp.upper, self.x)),
            l=np.where(self.rows, -np.inf, np.minimum(qp.l, values)),
            u=np.where(self.rows, np.inf, np.maximum(qp.u, values)),
            labels=replace(qp.labels, equality=qp.labels.equality + names),
        )


def achieved_rows(rows: Sequence[Rows], x: Array) -> list[Rows]:
    """Return equality rows that keep what ``x`` achieves for ``rows``; weightless rows are free."""
    held = []
    for row in rows:
        weighted = row.weight > 0.0
        matrix = row.matrix[weighted]
        held.append(Rows(matrix, matrix @ x[: matrix.shape[1]], np.ones(len(matrix))))
    return held


def _beside(held: Array, vectors: Array) -> Array:
    """Return vectors (m, n) less their parts in the row space of ``held`` (k, n)."""
    lengths = np.linalg.norm(held, axis=1)
    unit = held[lengths > 0.0] / lengths[lengths > 0.0, None]
    if not unit.size:  # rows may all be zero: of a frame that nothing moves
        return vectors
    packed, _, tau, _, _ = lapack.dgeqp3(unit.T)
    diagonal = np.abs(np.diagonal(packed))
    rank = int(np.count_nonzero(diagonal > RANK_TOLERANCE * diagonal[0]))
    Q, _, _ = lapack.dorgqr(packed[:, : tau.size], tau)
    basis = Q[:, :rank]
    return vectors - (vectors @ basis) @ basis.T


def _positive_kernel(vectors: Array, guess: Array) -> NDArray[np.int64]:
    """Return which vectors (m, n) take part in a combination ``z @ vectors = 0``, z > 0.

    The nearest such combination to ``guess`` (m,) is sought; all those returned do take part in
    one, but others may too.
    """
    kept = np.arange(len(vectors))
    while kept.size:
        columns = vectors[kept].T
        pull = columns @ guess[kept]
        z = guess[kept] - least_squares(columns, pull, CERTAIN)
        enough = z > CERTAIN * guess[kept].max()
        if enough.all():
            break
        kept = kept[enough]
    return kept
