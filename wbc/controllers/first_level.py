"""Who solves a tick's first level: the backend that was chosen, or, where it fails, the core."""

from __future__ import annotations

import logging
from collections.abc import Hashable
from typing import Any

import numpy as np

from wbc.controllers.core_memory import INFEASIBLE
from wbc.controllers.core_tick import CoreTick
from wbc.qp.active_set import NAME, NO_RESIDUALS, ActiveSet
from wbc.qp.backend import Backend
from wbc.qp.conflict import conflict_of
from wbc.qp.kkt import largest
from wbc.qp.problem import QP
from wbc.qp.proxqp import ProxQP
from wbc.qp.solution import Solution, Status
from wbc.validate import Array

# How far above eps the residuals of a relaxed QP may be: the other choice is a robot that is only
# brought to rest.
ENOUGH = 1000.0
# Of the largest curvature of a relaxed QP, what unknowns are damped by where weights are farther
# apart than numbers hold, one after the other; with 1e-10 one of five was still unsolved.
FAINT = (1e-9, 1e-7, 1e-5)


class FirstLevel:
    """A backend, and who is asked where it gives no answer.

    Parameters
    ----------
    torque:
        Whether it is for the torque level, where other backends are asked for a bounded attempt.
    """

    def __init__(self, backend: Backend, torque: bool) -> None:
        self._backend, self._torque = backend, torque
        self._own = isinstance(backend, ActiveSet | ProxQP)
        self._core = ActiveSet(backend.eps if isinstance(backend, ActiveSet | ProxQP) else 1e-8)
        self._said = False

    def solve(
        self, found: CoreTick, said: int | None, workspace: Hashable, hurried: bool
    ) -> Solution:
        """Return the checked solution of a tick's first level.

        Parameters
        ----------
        said:
            What the core said of it, if it was asked.
        workspace:
            Names the warm start; None: there is none, and will be none.
        hurried:
            Whether the deadline is over: what failed is not tried by other means.
        """
        qp, weights = found.qp_of(0), found.slack_weights
        if said == INFEASIBLE and weights is None:
            a = found.views
            conflict = conflict_of(qp, a.y, a.z, a.z_box)
            if conflict is not None:
                nowhere = np.full(qp.g.size, np.nan)
                parts = nowhere, a.y.copy(), a.z.copy(), a.z_box.copy(), Status.INFEASIBLE
                return Solution(*parts, NO_RESIDUALS, 0, found.done - found.begun, NAME, conflict)
        if weights is not None:
            return self._core.solve_soft(qp, weights)
        if said is not None:  # the core had no answer that is accurate enough, and no proof
            exact = self._core.solve(qp, quick=hurried)
            if hurried or self._torque or exact.solved or exact.status is Status.INFEASIBLE:
                return exact
        return self._asked(qp, workspace, hurried)

    def solve_relaxed(self, qp: QP, weights: Array | None, rest: Array) -> Solution:
        """Return the checked solution of a relaxed QP, its slacks behind the unknowns.

        Parameters
        ----------
        rest:
            Where unknowns (n,) stay as far as what is light is lost beside heavier weights.
        """
        if weights is None:
            return self._asked(qp, None, hurried=True)
        eps = ENOUGH * self._core.eps
        found = self._core.solve_soft(qp, weights, eps)
        if found.solved:
            return found
        size = largest(qp.P.diagonal())
        for faint in FAINT:
            P = qp.P / size + faint * np.eye(rest.size)
            eased = qp._replace(P=P, g=qp.g / size - faint * rest)
            found = self._core.solve_soft(eased, weights / size, eps)
            if found.solved:
                break
        else:
            return found
        y, z, z_box = (size * part for part in found[1:4])
        said = "weights are too far apart for numbers: what is light was lost beside the heaviest"
        return found._replace(y=y, z=z, z_box=z_box, message=said)

    def solve_once(self, qp: QP) -> Solution:
        """Return the checked solution of a QP that will not come again."""
        return self._core.solve(qp, quick=True)

    def _asked(self, qp: QP, workspace: Hashable, hurried: bool) -> Solution:
        # Solvers that qpsolvers knows take up to 150 ms for what they do not solve in the end.
        quick = hurried or (self._torque and not self._own)
        options: dict[str, Any] = {"quick": True} if quick else {}
        solution = self._backend.solve(qp, workspace=workspace, **options)
        if self._own or solution.solved or solution.status is Status.INFEASIBLE:
            return solution
        exact = self._core.solve(qp, quick=hurried)
        if exact.solved and not self._said:
            self._said = True
            logging.getLogger(__name__).warning(
                "QP solver %r left a QP unsolved (%s); %r answered, as it will others",
                *(self._backend.name, solution.message or solution.status.value, NAME),
            )
        spent = solution.solve_time + exact.solve_time
        return exact._replace(attempts=solution.attempts + 1, solve_time=spent)
