"""Eliminate the equality constraints of a QP: the same optimum from fewer unknowns.

With ``A x = b`` and a choice of dependent unknowns x_d for which A_d is regular,

    x_d = A_d^-1 (b - A_f x_f),        x = N x_f + x_0.

For a held foot this is the paper's elimination of the base velocity (eqs. 33-35, with the leg's own
adjoint in 33), with two feet also of six joint rates of the legs (eqs. 36-37). The paper always
solves for the right leg, whose Jacobian loses rank at a straight knee; here a QR factorisation with
column pivoting picks the best conditioned unknowns at each tick, and detects dependent rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from wbc.qp.conflict import find_conflict
from wbc.qp.kkt import acceptable, kkt_residuals
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import Solution, Status
from wbc.validate import Array

# A diagonal entry of R below this fraction of the largest marks rows that repeat the others.
RANK_TOLERANCE = 1e-9
# Entries of the basis below this are rounding. A row of them is a bound that the free unknowns can
# meet at 1e20 times their size, with a multiplier of 1e26: "solved" was said of such points.
BASIS_ROUNDING = 1e-12
# Unknowns without bounds are preferred as dependent ones: eliminating them adds no inequality row.
# The factor only biases the pivoting; a column that is nearly dependent is still passed over.
PREFERENCE = 10.0
# Accuracy to which a lifted solution must solve the full QP; the elimination adds its own rounding.
ADMITTED = 1e-7


@dataclass(frozen=True, slots=True)
class Factors:
    """``A[:, dependent] = Q R`` with Q (me, rank) orthonormal, R (rank, rank) upper triangular."""

    Q: Array
    R: Array
    dependent: np.ndarray
    free: np.ndarray
    R_free: Array


@dataclass(frozen=True, slots=True)
class Elimination:
    """A QP in the free unknowns only, and the way back.

    Attributes
    ----------
    full, reduced:
        The original QP and the one without equality rows; the reduced one has the inequality rows
        of the full one, then one row for each bounded dependent unknown.
    basis, offset:
        N (n, free) and x_0 (n,).
    mismatch:
        Largest entry of b outside the range of A: above rounding, the equalities are inconsistent.
    """

    full: QP
    reduced: QP
    factors: Factors
    basis: Array
    offset: Array
    bounded: np.ndarray
    mismatch: float

    def admits(self, solution: Solution) -> bool:
        """Whether a lifted solution solves the full QP: inconsistent equalities show only there."""
        s = solution
        return acceptable(s.residuals, ADMITTED, self.full, s.x, s.y, s.z, s.z_box)

    def lift(self, solution: Solution) -> Solution:
        """Return the solution of the full QP, with all its multipliers and residuals recomputed.

        Rows that contradict each other are looked for anew: without the equalities, which may be to
        blame, others would be.
        """
        qp, factors = self.full, self.factors
        x = self.basis @ solution.x + self.offset
        rows = qp.l.size
        z = solution.z[:rows]
        z_box = np.zeros(qp.g.size)
        z_box[factors.free] = solution.z_box
        z_box[self.bounded] = solution.z[rows:]
        slope = qp.P @ x + qp.g + z_box + qp.C.T @ z
        y = -factors.Q @ _triangular(factors.R, slope[factors.dependent], transposed=True)
        residuals = kkt_residuals(qp, x, y, z, z_box)
        lifted = solution._replace(x=x, y=y, z=z, z_box=z_box, residuals=residuals)
        if solution.conflict is None:
            return lifted
        conflict = find_conflict(qp)
        status = Status.FAILED if conflict is None else Status.INFEASIBLE
        return lifted._replace(conflict=conflict, status=status)


def eliminate(qp: QP) -> Elimination:
    """Return ``qp`` without its equality rows."""
    unbounded = np.isinf(qp.lower) & np.isinf(qp.upper)
    factors = factorise(qp.A, np.where(unbounded, PREFERENCE, 1.0))
    free, dependent = factors.free, factors.dependent
    in_range = factors.Q.T @ qp.b
    mismatch = float(np.abs(qp.b - factors.Q @ in_range).max(initial=0.0))
    follows = _triangular(factors.R, np.column_stack((in_range, factors.R_free)))
    follows[:, 1:][np.abs(follows[:, 1:]) < BASIS_ROUNDING] = 0.0
    n = qp.g.size
    basis, offset = np.zeros((n, free.size)), np.zeros(n)
    basis[free, np.arange(free.size)] = 1.0
    basis[dependent] = -follows[:, 1:]
    offset[dependent] = follows[:, 0]
    bounded = dependent[~unbounded[dependent]]
    reduced = _reduced(qp, basis, offset, free, bounded)
    return Elimination(qp, reduced, factors, basis, offset, bounded, mismatch)


def factorise(A: Array, preference: Array) -> Factors:
    """Return the pivoted QR factors of A (me, n), columns weighted by ``preference`` (n,)."""
    rows, n = A.shape
    if rows == 0:
        empty = np.zeros((0, 0))
        return Factors(empty, empty, np.zeros(0, dtype=int), np.arange(n), np.zeros((0, n)))
    packed, pivots, tau, _, _ = lapack.dgeqp3(A * preference)
    pivots = pivots - 1
    size = min(rows, n)
    diagonal = np.abs(np.diagonal(packed)[:size])
    rank = int(np.count_nonzero(diagonal > RANK_TOLERANCE * diagonal[0]))
    Q, _, _ = lapack.dorgqr(packed[:, :size].copy(order="F"), tau)
    R = np.triu(packed)[:rank] / preference[pivots]
    return Factors(Q[:, :rank], R[:, :rank], pivots[:rank], pivots[rank:], R[:, rank:])


def least_squares(matrix: Array, right: Array, tolerance: float) -> Array:
    """Return the least x (n,) of least ``|matrix x - right|``, by complete orthogonal factors.

    Singular values take three to five times as long, SciPy's own call of this a half more.
    ``tolerance``: singular values below this part of the largest count as 0.
    """
    rows, n = matrix.shape
    padded = np.zeros((max(rows, n), 1))
    padded[:rows, 0] = right
    size, _ = lapack.dgelsy_lwork(rows, n, 1, tolerance)
    pivots = np.zeros((n, 1), dtype=np.intc)
    _, x, *_ = lapack.dgelsy(matrix, padded, pivots, tolerance, int(size))
    solution: Array = x[:n, 0]
    return solution


def _reduced(qp: QP, basis: Array, offset: Array, free: np.ndarray, bounded: np.ndarray) -> QP:
    """Return the QP in the free unknowns: objective and rows pulled back through ``basis``."""
    P_basis = qp.P @ basis
    dependent = basis[bounded]
    C = np.concatenate((qp.C @ basis, dependent))
    shift = np.concatenate((qp.C @ offset, offset[bounded]))
    names = qp.labels.variables
    labels = Labels(
        equality=(),
        inequality=qp.labels.inequality + tuple(names[k] for k in bounded),
        variables=tuple(names[k] for k in free),
    )
    return QP(
        P=basis.T @ P_basis,
        g=basis.T @ qp.g + P_basis.T @ offset,
        A=np.zeros((0, free.size)),
        b=np.zeros(0),
        C=C,
        l=np.concatenate((qp.l, qp.lower[bounded])) - shift,
        u=np.concatenate((qp.u, qp.upper[bounded])) - shift,
        lower=qp.lower[free],
        upper=qp.upper[free],
        labels=labels,
    )


def _triangular(R: Array, right: Array, transposed: bool = False) -> Array:
    """Return R^-1 right, or R^-T right, for upper triangular R."""
    if len(R) == 0:
        return np.zeros_like(right)
    solved, _ = lapack.dtrtrs(R, right, trans=int(transposed))
    return solved
