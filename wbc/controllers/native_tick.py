"""Plain ticks by the native core, all others in Python: the same for both levels."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from time import perf_counter
from typing import Any, NamedTuple

from wbc.constraints.collision import SelfCollision
from wbc.controllers.controller import Controller
from wbc.controllers.level_problem import LevelProblem
from wbc.controllers.look_ahead import Attempt
from wbc.controllers.native_forces import TorqueRows
from wbc.controllers.native_given import GivenRows
from wbc.controllers.native_margin import only_self_collision
from wbc.controllers.native_plan import NativePlan, solves
from wbc.controllers.native_problem import NativeProblem
from wbc.controllers.plan import Physics
from wbc.controllers.tick import Tick
from wbc.laws import Rows
from wbc.qp.backend import Backend
from wbc.qp.work import Work
from wbc.robot import Snapshot
from wbc.tasks.returned import deviation_of, residual_of
from wbc.tasks.task import Task


class _Unsolved(NamedTuple):
    """What a plain tick came to without a command.

    Attributes
    ----------
    work:
        That it took.
    attempt:
        Its failed attempt, if the QP is not to be solved again.
    """

    work: Work
    attempt: Attempt | None = None


class NativeController(Controller):
    """A controller whose plain ticks are set up, and maybe solved, by the native core."""

    _native: NativePlan | None = None
    _second: NativePlan | None = None  # without margins, where the first has one

    @property
    def native(self) -> NativePlan | None:
        """What the core computes plain ticks by; None: all are computed in Python."""
        return self._native

    def _step(self, snapshot: Snapshot) -> Tick:
        """Return the command; what the core does not know goes through the Python tick."""
        plan = self._native
        if plan is None or not plan.serves(self.limits, self.dt):
            return self._step_within(Work(self.budget), snapshot)
        found = self._native_problem(plan, snapshot)
        if found is not None and found.solved:
            # The core kept the box to the accuracy promised, far below what a command may exceed.
            return self._native_tick(found, snapshot)
        attempted = self._native_attempt(plan, found, snapshot)
        if isinstance(attempted, Tick):
            return attempted
        return self._step_within(attempted.work, snapshot, attempted.attempt)

    def _native_attempt(
        self, plan: NativePlan, found: NativeProblem | None, snapshot: Snapshot
    ) -> Tick | _Unsolved:
        """Return the command of a tick whose problem the core did not solve, or what came of it.

        ``found`` is the problem; None: the tick is not plain.
        """
        start = perf_counter() if found is None else found.begun
        work = Work(self.budget)
        work.spent += plan.spent
        refused = found is not None and found.refused  # DAQP found no answer
        if plan.margin is not None:
            # Where an answer leads inside, rows are added by Python.
            if self._second is None:
                return _Unsolved(work)
            given = None if found is None else found.given
            found = self._native_problem(self._second, snapshot, given)
            if found is not None and found.solved:
                return self._native_tick(found, snapshot)
            work.spent += self._second.spent
        if found is None:
            return _Unsolved(work)
        physics, qp, nv = self._native_physics(found, snapshot), found.qp, self.robot.nv
        # Met exactly: weights are not read.
        held = [Rows(qp.A, qp.b, weight=qp.b)] if qp.b.size else []
        box = qp.lower[:nv], qp.upper[:nv]
        refused = self._relaxes and (refused or found.refused)
        problem = LevelProblem(
            snapshot, [], held, physics, box, None, work, found.assembled, refused
        )
        margins = None
        if self.constraints:
            margins = self._margins(snapshot, work)
        ready = perf_counter()
        attempt = self._attempt(problem, margins)
        if not attempt.outcome.solved:
            # The same QP, to rounding, need not be solved again where the level relaxes it, or
            # work is counted; else the Python tick finds out why, and what is best then.
            return _Unsolved(work, attempt if self._relaxes or work.is_limited else None)
        residuals = {name: found.residual(name) for name in found.errors}
        return self._tick(snapshot, physics, residuals, attempt, {}, work, start, ready)

    def _known_errors(self, found: NativeProblem, snapshot: Snapshot) -> dict[str, Any]:
        """Return the errors where tasks report others than their residuals': of targets of now."""
        errors = dict(found.errors)
        for task in self._deviating:
            errors[task.name] = deviation_of(task, snapshot, found.residual(task.name))
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

    def _native_plan(
        self, backend: Backend | None, margin: SelfCollision | None
    ) -> NativePlan | None:
        """Return the plan for the core; None: its ticks are not plain."""
        tasks, rows = self._native_parts()
        return NativePlan.of(
            self.robot,
            tasks,
            self.plan,
            self.limits,
            self.dt,
            backend,
            rows,
            margin,
            shares_state=margin is None and bool(self.constraints),  # margins look at it too
            units=0.5 * self.budget,
        )

    # ------------------------------------------------------------------ what a level says

    @abstractmethod
    def _native_parts(self) -> tuple[Sequence[Task], TorqueRows | None]:
        """Return the tasks, and what the torque level adds."""

    def _native_problem(
        self, plan: NativePlan, snapshot: Snapshot, given: Sequence[GivenRows] | None = None
    ) -> NativeProblem | None:
        """Return the QP of a tick; ``given`` are rows that were worked out before, for another."""
        begun = perf_counter()
        rows = self._given_rows(plan, snapshot) if given is None else given
        return plan.problem(snapshot, given=rows, begun=begun)

    def _given_rows(self, plan: NativePlan, snapshot: Snapshot) -> list[GivenRows]:
        """Return the rows of tasks that the core does not know, those about forces last."""
        found = []
        for task in plan.given:
            residual = residual_of(task, snapshot, core=not self._bears)
            rows = self._law(task, residual, snapshot)
            found.append(GivenRows(task.name, rows, residual))
        return found

    @abstractmethod
    def _native_tick(self, found: NativeProblem, snapshot: Snapshot) -> Tick:
        """Return the tick of a QP that the core solved."""

    @abstractmethod
    def _native_physics(self, found: NativeProblem, snapshot: Snapshot) -> Physics:
        """Return what ties the unknowns behind v+ to it."""
