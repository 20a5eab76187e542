"""The velocity level: inverse kinematics by one QP per tick; the unknown is the velocity."""

from __future__ import annotations

from time import perf_counter

from wbc.controllers.controller import Controller
from wbc.controllers.native_plan import NativePlan
from wbc.controllers.tick import Tick
from wbc.laws import Residual, Rows
from wbc.robot import Snapshot
from wbc.tasks.task import Task


class KinematicController(Controller):
    """Inverse kinematics by one QP per tick; the unknown is the velocity v.

    Tasks are driven by their :class:`~wbc.laws.VelocityLaw`. See
    :class:`~wbc.controllers.controller.Controller` for the parameters.
    """

    _native: NativePlan | None = None

    def _step(self, snapshot: Snapshot) -> Tick:
        """Return the command; plain ticks are set up by the native core where there is one."""
        start = perf_counter()
        found = None
        if self._native is not None and self._native.serves(self.limits, self.dt):
            found = self._native.problem(snapshot)
        if found is not None:
            ready = perf_counter() - (found.solution.solve_time if found.solution else 0.0)
            outcome = self._within_limits(self._solver.solve_plain(found.qp, found.solution))
            if outcome.solved:
                return self._tick(snapshot, found.residuals, outcome, 1.0, {}, start, ready)
        return super()._step(snapshot)

    def _plan(self, contacts: tuple[Task, ...]) -> None:
        super()._plan(contacts)
        self._native = None
        if not self.constraints:
            backend = self.backend if self.formulation == "equality" else None
            self._native = NativePlan.of(
                self.robot, self.tasks, self.plan, self.limits, self.dt, backend
            )

    def _law(self, task: Task, residual: Residual, snapshot: Snapshot) -> Rows:
        return task.law.rows(residual, task.weight, self.dt)
