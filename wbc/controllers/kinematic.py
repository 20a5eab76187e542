"""The velocity level: inverse kinematics by one QP per tick; the unknown is the velocity."""

from __future__ import annotations

from time import perf_counter

from wbc.controllers.controller import Controller
from wbc.controllers.levels import LevelProblem, Outcome
from wbc.controllers.look_ahead import MarginRows
from wbc.controllers.native_plan import NativePlan
from wbc.controllers.plan import NO_PHYSICS
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
        start, found = perf_counter(), None
        if self._native is not None and self._native.serves(self.limits, self.dt):
            found = self._native.problem(snapshot)
        if found is None:
            return super()._step(snapshot)
        qp, step_scale = found.qp, 1.0
        if found.solution is not None:
            ready = perf_counter() - found.solution.solve_time
            # The core kept the box to the accuracy promised, far below what a command may exceed.
            outcome = Outcome(qp, found.solution, qp, self.robot.nv, found.solution.solve_time, {})
        else:
            held = [Rows(qp.A, qp.b, qp.b)] if qp.b.size else []
            box = qp.lower, qp.upper
            problem = LevelProblem(snapshot, [], held, NO_PHYSICS, box, None, found.assembled)
            margins = None
            if self.constraints:
                margins = MarginRows.at(snapshot, self.constraints, self.slacks, self.dt)
            ready = perf_counter()
            outcome, step_scale = self._solve(problem, margins)
            if not outcome.solved:  # the Python tick finds out why, and what is best then
                return super()._step(snapshot)
        return self._tick(
            snapshot, NO_PHYSICS, found.residuals, outcome, step_scale, {}, start, ready
        )

    def _plan(self, contacts: tuple[Task, ...]) -> None:
        super()._plan(contacts)
        # Without margins in between, DAQP runs in the core as well.
        plain = self.formulation == "equality" and not self.constraints
        backend = self.backend if plain else None
        self._native = NativePlan.of(
            self.robot, self.tasks, self.plan, self.limits, self.dt, backend
        )

    def _law(self, task: Task, residual: Residual, snapshot: Snapshot) -> Rows:
        return task.law.rows(residual, task.weight, self.dt)
