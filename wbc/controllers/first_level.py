"""Solving a tick's first level: by the chosen backend or, where that fails, by the core."""

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

# Residuals of a relaxed QP may be this many times eps: otherwise the robot is only brought to rest.
RELAXED_TOLERANCE = 1000.0
# Damping of a relaxed QP whose weights span more than double precision, by its largest curvature,
# tried in this order; with 1e-10 one of five was still unsolved.
RELAXED_DAMPING = (1e-9, 1e-7, 1e-5)


class FirstLevel:
    """A backend, with the core's active-set method where it fails.

    ``torque``: whether it is for the torque level, where qpsolvers' backends get one bounded
    attempt.
    """

    def __init__(self, backend: Backend, torque: bool) -> None:
        self._backend, self._torque = backend, torque
        self._own = isinstance(backend, ActiveSet | ProxQP)
        self._core = ActiveSet(backend.eps if isinstance(backend, ActiveSet | ProxQP) else 1e-8)
        self._warned = False

    def solve(
        self, found: CoreTick, status: int | None, workspace: Hashable, deadline_over: bool
    ) -> Solution:
        """Return the checked solution of a tick's first level.

        ``status``: the core's, if it has tried to solve it.
        ``workspace``: key of the warm start; None: no warm start.
        ``deadline_over``: if so, a failure is not followed by another attempt.
        """
        qp, weights = found.qp_of(0), found.slack_weights
        if status == INFEASIBLE and weights is None:
            a = found.views
            conflict = conflict_of(qp, a.y, a.z, a.z_box)
            if conflict is not None:
                nowhere = np.full(qp.g.size, np.nan)
                parts = nowhere, a.y.copy(), a.z.copy(), a.z_box.copy(), Status.INFEASIBLE
                return Solution(
                    *parts, NO_RESIDUALS, 0, found.done - found.start_time, NAME, conflict
                )
        if weights is not None:
            return self._core.solve_soft(qp, weights)
        if status is not None:  # the core found no accurate solution, and no certificate
            exact = self._core.solve(qp, quick=deadline_over)
            if deadline_over or self._torque or exact.solved or exact.status is Status.INFEASIBLE:
                return exact
        return self._solve_by_backend(qp, workspace, deadline_over)

    def solve_relaxed(self, qp: QP, weights: Array | None, rest: Array) -> Solution:
        """Return the checked solution of a relaxed QP, its slacks behind the unknowns.

        ``rest``: (n,) values that the damping draws unknowns to, where light costs are below
        rounding.
        """
        if weights is None:
            return self._solve_by_backend(qp, None, deadline_over=True)
        eps = RELAXED_TOLERANCE * self._core.eps
        found = self._core.solve_soft(qp, weights, eps)
        if found.solved:
            return found
        size = largest(qp.P.diagonal())
        for damping in RELAXED_DAMPING:
            P = qp.P / size + damping * np.eye(rest.size)
            damped = qp._replace(P=P, g=qp.g / size - damping * rest)
            found = self._core.solve_soft(damped, weights / size, eps)
            if found.solved:
                break
        else:
            return found
        y, z, z_box = (size * part for part in found[1:4])
        said = "weights are too far apart for numbers: what is light was lost beside the heaviest"
        return found._replace(y=y, z=z, z_box=z_box, message=said)

    def solve_once(self, qp: QP) -> Solution:
        """Return the checked solution of a QP, without a warm start."""
        return self._core.solve(qp, quick=True)

    def _solve_by_backend(self, qp: QP, workspace: Hashable, deadline_over: bool) -> Solution:
        # qpsolvers' backends take up to 150 ms for QPs that they do not solve in the end.
        quick = deadline_over or (self._torque and not self._own)
        options: dict[str, Any] = {"quick": True} if quick else {}
        solution = self._backend.solve(qp, workspace=workspace, **options)
        if self._own or solution.solved or solution.status is Status.INFEASIBLE:
            return solution
        exact = self._core.solve(qp, quick=deadline_over)
        if exact.solved and not self._warned:
            self._warned = True
            logging.getLogger(__name__).warning(
                "QP solver %r left a QP unsolved (%s); %r answered, as it will others",
                *(self._backend.name, solution.message or solution.status.value, NAME),
            )
        spent = solution.solve_time + exact.solve_time
        return exact._replace(attempts=solution.attempts + 1, solve_time=spent)
