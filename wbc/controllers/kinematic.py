"""The velocity level: inverse kinematics by one QP per tick; the unknown is the velocity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.controllers.levels import Outcome
from wbc.controllers.native_problem import NativeProblem
from wbc.controllers.native_tick import NativeController
from wbc.controllers.plan import NO_PHYSICS, Physics
from wbc.controllers.slack import slacks_of
from wbc.controllers.tick import Tick
from wbc.laws import Residual, Rows
from wbc.qp.least_infeasible import least_infeasible
from wbc.qp.work import Work
from wbc.robot import Snapshot
from wbc.robot.tree import LARGEST
from wbc.tasks.returned import rows_of
from wbc.tasks.task import Task
from wbc.validate import Array


class KinematicController(NativeController):
    """Inverse kinematics by one QP per tick; the unknown is the velocity v.

    Tasks are driven by their :class:`~wbc.laws.VelocityLaw`. See
    :class:`~wbc.controllers.controller.Controller` for the parameters.
    """

    def _law(self, task: Task, residual: Residual, snapshot: Snapshot) -> Rows:
        return rows_of(task, task.law, residual, task.weight, self.dt)

    def _native_parts(self) -> tuple[Sequence[Task], None]:
        return self.tasks, None

    def _native_tick(self, found: NativeProblem, snapshot: Snapshot) -> Tick:
        known = self._known_errors(found, snapshot) if self._deviating else None
        return Tick.reading(found, found.velocity, known)

    def _native_physics(self, found: NativeProblem, snapshot: Snapshot) -> Physics:
        return NO_PHYSICS

    def _fallback(
        self, snapshot: Snapshot, outcome: Outcome, work: Work
    ) -> tuple[Array, dict[str, float]]:
        nv = self.robot.nv
        if self.on_failure == "closest":
            most = np.full(outcome.first.g.size, np.inf)
            most[:nv] = LARGEST  # where there are no limits
            lower, upper = np.fmax(outcome.first.lower, -most), np.fmin(outcome.first.upper, most)
            qp = outcome.first._replace(lower=lower, upper=upper)
            found = least_infeasible(qp, work=work)
            return found.x[:nv], {**slacks_of(outcome.first, found.x), **found.slack}
        if self.on_failure == "damp":
            return np.clip(0.5 * snapshot.v, *outcome.box), {}
        return np.zeros(nv), {}
