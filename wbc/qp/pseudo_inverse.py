"""A damped pseudo-inverse as a baseline, clipped to the bounds: eq. 38 for all unknowns."""

from __future__ import annotations

from collections.abc import Hashable
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from wbc.errors import InvalidInputError
from wbc.qp.kkt import kkt_residuals
from wbc.qp.problem import QP, check_qp
from wbc.qp.solution import Solution, Status
from wbc.validate import Array

# A diagonal entry of R below this share of the largest marks redundant rows.
RANK = 1e-9
# Unknowns without bounds are preferred as dependent ones: clipping does not break their rows.
UNBOUNDED_PREFERENCE = 10.0


class PseudoInverse:
    """The damped least-squares step under the equalities: no optimum under bounds.

    With P = J'J + damping and g = -J'w it is (J'J + damping 1)^-1 J'w, the equalities eliminated.
    With ``gain=1, curvature_damping=False`` on the tasks and a damping that tends to 0 it is eq. 38
    of a floating robot. With contacts it is not the paper's step: of all v that meet the task it is
    the least as a whole, the base's metres and radians and both legs among it, where the paper's
    is the one whose independent coordinates (5.2) are least; the two differ by 4 to 52 %. The
    paper's is :meth:`wbc.IndependentCoordinates.step`. Bounds are an afterthought, as they are to a
    pseudo-inverse: independent unknowns are clipped, so what the clipped ones should have done is
    lost, and dependent ones may leave their bounds. The residuals show by how much this is not the
    optimum; the status says only that an answer was found.
    """

    name = "pseudo_inverse"

    def solve(self, qp: QP, workspace: Hashable = "default", quick: bool = False) -> Solution:
        """Return the clipped pseudo-inverse solution of ``qp``.

        Raises InvalidInputError: see :func:`~wbc.qp.problem.check_qp`; or the QP has inequality
        rows.
        """
        start = perf_counter()
        check_qp(qp)
        if qp.u.size:
            raise InvalidInputError(
                f"pseudo-inverse: it cannot keep {qp.labels.inequality[0]!r} or any other "
                "inequality row; use a QP solver, or leave the constraints out"
            )
        free, basis, offset = _without_equalities(qp)
        P, g = basis.T @ qp.P @ basis, basis.T @ (qp.g + qp.P @ offset)
        unclipped = np.linalg.solve(P, -g)
        clipped = np.clip(unclipped, qp.lower[free], qp.upper[free])
        x, z_box = basis @ clipped + offset, np.zeros(qp.g.size)
        z_box[free] = np.where(clipped != unclipped, -(P @ clipped + g), 0.0)
        z = np.zeros(0)
        gradient = qp.P @ x + qp.g + z_box
        # gelsd, the default, has no answer where its iteration does not converge.
        y = -linalg.lstsq(qp.A.T, gradient, RANK, lapack_driver="gelsy")[0] if qp.b.size else z
        residuals = kkt_residuals(qp, x, y, z, z_box)
        status = Status.SOLVED if np.isfinite(x).all() else Status.FAILED
        spent = perf_counter() - start
        return Solution(x, y, z, z_box, status, residuals, 1, spent, self.name)


def _without_equalities(qp: QP) -> tuple[NDArray[np.int64], Array, Array]:
    """Return independent unknowns, and x (n,) by them: a basis (n, k) and an offset (n,).

    QR with column pivoting picks the others, those without bounds first, and drops rows that
    repeat others.
    """
    n, me = qp.g.size, qp.b.size
    if not me:
        return np.arange(n), np.eye(n), np.zeros(n)
    bounded = np.isfinite(qp.lower) | np.isfinite(qp.upper)
    scale = np.where(bounded, 1.0, UNBOUNDED_PREFERENCE)
    Q, R, order = linalg.qr(qp.A * scale, mode="economic", pivoting=True)
    diagonal = np.abs(np.diagonal(R))
    rank = int(np.count_nonzero(diagonal > RANK * diagonal[0]))
    dependent, free = order[:rank], order[rank:]
    R = R[:rank] / scale[order]
    follows = np.linalg.solve(R[:, :rank], np.column_stack((Q.T[:rank] @ qp.b, R[:, rank:])))
    basis, offset = np.zeros((n, free.size)), np.zeros(n)
    basis[free, np.arange(free.size)] = 1.0
    basis[dependent], offset[dependent] = -follows[:, 1:], follows[:, 0]
    return free, basis, offset
