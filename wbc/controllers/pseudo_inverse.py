"""The paper's own controller as a baseline: a damped pseudo-inverse (eq. 38), clipped."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np

from wbc.controllers.kinematic import KinematicController
from wbc.errors import InvalidInputError
from wbc.qp.elimination import eliminate
from wbc.qp.kkt import KktResiduals
from wbc.qp.problem import QP
from wbc.qp.solution import Solution, Status


class PseudoInverseController(KinematicController):
    """Eq. 38, made usable: all tasks at once, in the independent coordinates of the support.

    The velocity is (J'J + damping 1)^-1 J' (wanted rates), J the weighted rows of all tasks after
    the contacts were eliminated (paper 5.2). Two repairs are needed to print eq. 38 as code: it
    steps by the error at once and without damping, though the inertia's rows nearly lose rank.

    Limits are an afterthought, as they are to a pseudo-inverse: independent velocities are clipped
    to the box, so what the clipped joints should have done is lost, and dependent joints may leave
    their range. The residuals of the full QP that each tick reports show by how much this is not
    the optimum; the status says only that a command was found. Constraints are refused.
    """

    def __init__(self, *args: Any, damping: float = 1e-3, **kwargs: Any) -> None:
        if kwargs.get("constraints"):
            raise InvalidInputError(
                "pseudo-inverse controller: it cannot keep constraints; use KinematicController"
            )
        kwargs["formulation"] = "reduced"
        super().__init__(*args, damping=damping, **kwargs)

    def _solve(self, qp: QP) -> Solution:
        """Solve without bounds, clip, and report the residuals of the bounded problem."""
        start = perf_counter()
        elimination = eliminate(qp)
        reduced = elimination.reduced
        free = np.linalg.solve(reduced.P, -reduced.g)
        x = np.clip(free, reduced.lower, reduced.upper)
        z_box = np.where(x != free, -(reduced.P @ x + reduced.g), 0.0)
        answer = Solution(
            x=x,
            y=np.zeros(0),
            z=np.zeros(reduced.l.size),
            z_box=z_box,
            status=Status.SOLVED if np.isfinite(x).all() else Status.FAILED,
            residuals=KktResiduals(0.0, 0.0, 0.0),  # those of the full QP follow in lift()
            iterations=1,
            solve_time=perf_counter() - start,
            solver="pseudo_inverse",
        )
        return elimination.lift(answer)
