"""The paper's own step as a baseline: a damped pseudo-inverse (eq. 38), clipped to the bounds."""

from __future__ import annotations

from collections.abc import Hashable
from time import perf_counter

import numpy as np

from wbc.errors import InvalidInputError
from wbc.qp.elimination import eliminate
from wbc.qp.problem import QP, check_qp
from wbc.qp.solution import KktResiduals, Solution, Status


class PseudoInverse:
    """Eq. 38 in the independent coordinates of the support: no optimum under bounds.

    With P = J'J + damping and g = -J'w the answer is (J'J + damping 1)^-1 J'w after the equalities
    were eliminated (paper 5.2). With ``gain=1, curvature_damping=False`` on the tasks and a damping
    that tends to 0 it is the paper's step. Bounds are an afterthought, as they are to a
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
