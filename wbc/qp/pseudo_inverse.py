"""A damped pseudo-inverse as a baseline, clipped to the bounds: eq. 38 for all unknowns."""

from __future__ import annotations

from collections.abc import Hashable
from time import perf_counter

import numpy as np

from wbc.errors import InvalidInputError
from wbc.qp.elimination import eliminate
from wbc.qp.problem import QP, check_qp
from wbc.qp.solution import KktResiduals, Solution, Status


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

        Raises
        ------
        InvalidInputError
            See :func:`~wbc.qp.problem.check_qp`; or the QP has inequality rows.
        """
        start = perf_counter()
        check_qp(qp)
        if qp.u.size:
            raise InvalidInputError(
                f"pseudo-inverse: it cannot keep {qp.labels.inequality[0]!r} or any other "
                "inequality row; use a QP solver, or leave the constraints out"
            )
        elimination = eliminate(qp)
        reduced = elimination.reduced
        unclipped = np.linalg.solve(reduced.P, -reduced.g)
        x = np.clip(unclipped, reduced.lower, reduced.upper)
        answer = Solution(
            x=x,
            y=np.zeros(0),
            z=np.zeros(reduced.u.size),
            z_box=np.where(x != unclipped, -(reduced.P @ x + reduced.g), 0.0),
            status=Status.SOLVED if np.isfinite(x).all() else Status.FAILED,
            residuals=KktResiduals(0.0, 0.0, 0.0),  # those of the full QP follow in lift()
            iterations=1,
            solve_time=perf_counter() - start,
            solver=self.name,
        )
        return elimination.lift(answer)
