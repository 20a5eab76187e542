"""Plain ticks by the native core, all others in Python: the same for both levels."""

from __future__ import annotations

from abc import abstractmethod
from time import perf_counter
from typing import Any

from wbc.constraints.collision import SelfCollision
from wbc.controllers.controller import Controller
from wbc.controllers.levels import LevelProblem
from wbc.controllers.look_ahead import Attempt
from wbc.controllers.native_margin import only_self_collision
from wbc.controllers.native_plan import NativePlan, solves
from wbc.controllers.native_problem import NativeProblem
from wbc.controllers.plan import Physics
from wbc.controllers.tick import Tick
from wbc.controllers.work import Work
from wbc.laws import Rows
from wbc.qp.backend import Backend
from wbc.robot import Snapshot
from wbc.tasks.task import Task


class NativeController(Controller):
    """A controller whose plain ticks are set up, and maybe solved, by the native core."""

    _native: NativePlan | None = None
    _second: NativePlan | None = None  # without margins, where the first has one

    @property
    def native(self) -> NativePlan | None:
        """What the core computes plain ticks by; None: all are computed in Python."""
        return self._native

    def _step(self, snapshot: Snapshot, tried: Attempt | None = None) -> Tick:
        """Return the command; what the core does not know goes through the Python tick."""
        plan = self._native
        if plan is not None and plan.serves(self.limits, self.dt):
            found = self._native_step(plan, snapshot)
            if isinstance(found, Tick):
                return found
            tried = found
        return super()._step(snapshot, tried)

    def _native_step(self, plan: NativePlan, snapshot: Snapshot) -> Tick | Attempt | None:
        """Return the command of a plain tick; None: not plain, or without a solution.

        Where a level relaxes what has no solution, its failed attempt: the same QP, to rounding,
        need not be solved again before.
        """
        start = perf_counter()
        if self.constraints and plan.margin is None and snapshot.native_state is None:
            return None  # margins look at it too
        found = self._native_problem(plan, snapshot)
        if plan.margin is not None and (found is None or not found.solved):
            # Where an answer leads inside, rows are added by Python.
            second = self._second
            return None if second is None else self._native_step(second, snapshot)
        if found is None:
            return None
        if found.solved:
            # The core kept the box to the accuracy promised, far below what a command may exceed.
            return self._native_tick(found, snapshot, self._deviations(found, snapshot))
        physics, qp, nv = self._native_physics(found, snapshot), found.qp, self.robot.nv
        # Met exactly: weights are not read.
        held = [Rows(qp.A, qp.b, weight=qp.b)] if qp.b.size else []
        box = qp.lower[:nv], qp.upper[:nv]
        work = Work(self.budget)
        problem = LevelProblem(snapshot, [], held, physics, box, None, work, found.assembled)
        margins = None
        if self.constraints:
            margins = self._margins(snapshot, work)
        ready = perf_counter()
        attempt = self._attempt(problem, margins)
        if not attempt.outcome.solved:  # the Python tick finds out why, and what is best then
            return attempt if self._relaxes else None
        residuals = {name: found.residual(name) for name in found.errors}
        return self._tick(snapshot, physics, residuals, attempt, {}, work, start, ready)

    def _deviations(self, found: NativeProblem, snapshot: Snapshot) -> dict[str, Any]:
        """Return the errors if tasks report others than theirs: they are about their targets."""
        if not self._deviating:
            return {}
        errors = dict(found.errors)
        for task in self._deviating:
            errors[task.name] = task.deviation(snapshot, found.residual(task.name))
        return {"errors": errors}

    def _plan(self, contacts: tuple[Task, ...]) -> None:
        super()._plan(contacts)
        # With no margins but one that the core knows, DAQP runs in the core as well.
        plain, margin = self.formulation == "equality" and not self.constraints, None
        if self.formulation == "equality" and solves(self.backend):
            margin = only_self_collision(self.constraints, self.slacks)
        self._second = None
        self._native = self._native_plan(self.backend if plain else None, None)
        if margin is not None and self._native is not None:
            first = self._native_plan(self.backend, margin)
            if first is not None:
                self._native, self._second = first, self._native

    # ------------------------------------------------------------------ what a level says

    @abstractmethod
    def _native_plan(
        self, backend: Backend | None, margin: SelfCollision | None
    ) -> NativePlan | None:
        """Return the plan for the core; None: its ticks are not plain."""

    def _native_problem(self, plan: NativePlan, snapshot: Snapshot) -> NativeProblem | None:
        """Return the QP of a tick."""
        return plan.problem(snapshot)

    @abstractmethod
    def _native_tick(self, found: NativeProblem, snapshot: Snapshot, known: dict[str, Any]) -> Tick:
        """Return the tick of a QP that the core solved, with what is ``known`` of it besides."""

    @abstractmethod
    def _native_physics(self, found: NativeProblem, snapshot: Snapshot) -> Physics:
        """Return what ties the unknowns behind v+ to it."""
