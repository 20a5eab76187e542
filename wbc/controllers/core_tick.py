"""The core's result at one snapshot: the QPs of all levels, and their solutions.

All of it lies in one array. Most ticks are read for their command alone, so the rest is unpacked
on demand.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wbc.constraints.rows import Bounds
from wbc.controllers.blocks import TaskEvaluation
from wbc.controllers.core_layout import LevelViews
from wbc.controllers.core_memory import CoreMemory
from wbc.controllers.singular import Singularity
from wbc.controllers.slack import NEGLIGIBLE, SlackQP
from wbc.controllers.tick import Times
from wbc.laws import Residual
from wbc.qp.active_set import NAME
from wbc.qp.problem import QP, Labels
from wbc.qp.proxqp import SolverCall
from wbc.qp.solution import KktResiduals, Solution, Status
from wbc.validate import Array, read_only

_NONE: Array = read_only(np.zeros(0))
# Named as solver where the optimum of the cost alone keeps all bounds and rows.
NO_SOLVER = "cholesky"


class TickNames(NamedTuple):
    """Names that all ticks of a plan share."""

    errors: dict[str, slice]  # by task: where its error is among all
    labels: Sequence[Labels]  # of each level's QP; the tick adds those of inequality rows
    levels: Sequence[str]  # descriptions of the levels, for those left out


class CoreTick:
    """The QPs of a tick, and their checked solutions.

    ``start_time``, ``call_time``, ``done``: when the tick began, when the core was called, and when
    it was done [s].

    ``evaluations``: residuals of the tasks that Python evaluated.
    ``solved``: whether there is a command.
    ``first_call``: the solver call of the first level; None: the core's own.
    ``first_solution``: the first level's solution if another solver found it.
    ``skipped``: steps that were left out because the deadline was over, or because they failed.
    ``relaxed``: the QP in which only physics is hard, if the original had no solution.
    """

    status, policy = Status.SOLVED, None
    first_call: SolverCall | None = None
    first_solution: Solution | None = None
    relaxed: SlackQP | None = None
    skipped: tuple[str, ...] = ()
    solved = False
    evaluations: Sequence[TaskEvaluation] = ()
    _force_labels: tuple[str, ...] = ()  # of torque bounds and cones, in this tick
    _row_labels: tuple[str, ...] = ()
    _slack_weights: Array | None = None
    done: float

    def __init__(
        self, memory: CoreMemory, names: TickNames, start_time: float, call_time: float
    ) -> None:
        self._memory, self._names, self._layout = memory, names, memory.layout
        self._out, self._below, self._given_rows = memory.out, memory.below, memory.given_rows
        self.start_time, self._call_time = start_time, call_time
        if memory.forces is not None:
            self._force_labels = memory.forces.labels

    def with_bounds(self, bounds: Bounds) -> None:
        """Store labels and slack weights of the inequality rows of constraints in Python."""
        self._row_labels = bounds.labels
        self._slack_weights = bounds.slack if bounds.labels else None

    @cached_property
    def singular(self) -> dict[str, Singularity]:
        """By task with a singular threshold: how singular it is."""
        return {}

    def set_solution(self, level: int, solution: Solution) -> None:
        """Write another attempt's solution of a level into the core's memory."""
        a, n = self.views_of(level), self.views.x.size
        a.x[:], a.y[:], a.z[:] = solution.x[:n], solution.y, solution.z
        a.z_box[:] = solution.z_box[:n]
        a.found[:3], a.found[3] = solution.residuals, solution.iterations
        self.views.found[4] = level + 1.0
        if level == 0:
            self.first_solution = solution

    def replace_by(self, other: CoreTick) -> None:
        """Become ``other``, a tick at the same snapshot in other memory."""
        self.__dict__ = other.__dict__.copy()

    # ------------------------------------------------------------------ the QPs

    @property
    def level(self) -> int:
        """The last level that was solved."""
        if self._memory.levels == 1:
            return 0
        solved = self._out.item(self._layout.found.stop - 1)
        return max(int(solved) - 1, 0)

    @property
    def is_whole(self) -> bool:
        """Whether there is a command by all levels."""
        levels = self._memory.levels
        return self.solved and (levels == 1 or self.level == levels - 1)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Levels that were not solved, and steps that were skipped."""
        return (*self._names.levels[self.level + 1 :], *self.skipped)

    @cached_property
    def views(self) -> LevelViews:
        """The first level's QP and solution, and the other results of the tick."""
        return self._layout.read(self._out, self._below)

    def views_of(self, level: int) -> LevelViews:
        """Return the views on a level; below the first only the last one posed has any."""
        if level == 0:
            return self.views
        layout = self._memory.layout_of(level, self._given_rows)
        return layout.read(self._out, self._below)

    def qp_of(self, level: int) -> QP:
        """Return the QP of a level, without slacks; see :meth:`views_of`."""
        a, labels, rows = self.views_of(level), self._names.labels[level], self._force_labels
        margin = self._memory.margin
        if margin is not None:
            rows += margin.labels(a.chosen)
        rows += self._row_labels
        if rows:
            labels = Labels(labels.equality, rows, labels.variables)
        return QP(a.P, a.g, a.A, a.b, a.C, a.l, a.u, a.lower, a.upper, labels)

    @cached_property
    def qp(self) -> QP:
        """The QP of the last level that was solved, or the relaxed one."""
        if self.relaxed is not None:
            return self.relaxed.qp
        return self.qp_of(self.level)

    @property
    def box(self) -> tuple[Array, Array]:
        """The bounds (nv,), (nv,) on the velocity in the first level."""
        nv = self._memory.tree.nv
        return self.views.lower[:nv], self.views.upper[:nv]

    @property
    def slack_weights(self) -> Array | None:
        """Slack weights (m,) of all inequality rows, infinite for hard ones; None: all hard."""
        if self._slack_weights is None:
            return None
        weights = np.full(self._layout.sizes[2], np.inf)
        weights[weights.size - self._slack_weights.size :] = self._slack_weights
        return weights

    @property
    def slack(self) -> dict[str, float]:
        """Nonzero slack of the soft rows, by name."""
        weights = self._slack_weights
        if weights is None:
            return {}
        slack = self.views.z[-weights.size :] / weights  # which lower levels keep
        missed = np.flatnonzero(np.abs(slack) > NEGLIGIBLE)
        return {self._row_labels[k]: float(slack[k]) for k in missed.tolist()}

    @cached_property
    def errors(self) -> dict[str, Array]:
        """Error of each task, by name."""
        every = self.views.errors.copy()  # may be kept longer than the QP
        return {name: every[where] for name, where in self._names.errors.items()}

    def residual(self, name: str) -> Residual:
        """Return a task's residual, without derivatives if the core evaluated it."""
        for one in self.evaluations:
            if one.task.name == name and one.residual is not None:
                return one.residual
        return Residual(self.errors[name], _NONE, _NONE)

    # ------------------------------------------------------------------ the answers

    @cached_property
    def solution(self) -> Solution:
        """The answer of the last level that was solved."""
        level = self.level
        if level == 0 and self.first_solution is not None:
            return self.first_solution
        return self._solution(level)

    def _solution(self, level: int) -> Solution:
        a, by = self.views_of(level), self.first_call if level == 0 else None
        *residuals, iterations, _ = a.found.tolist()
        if by is None:
            by = SolverCall(NAME if iterations else NO_SOLVER, 1)
        known, spent = KktResiduals(*residuals), self.done - self._call_time
        done = Status.SOLVED, known, int(iterations), spent, by.solver, None, by.attempts
        return Solution(a.x.copy(), a.y.copy(), a.z.copy(), a.z_box.copy(), *done)

    @property
    def velocity(self) -> Array:
        """The command v+ (nv,), a read-only copy; the torque level's meets the base's dynamics."""
        memory = self._memory
        if self.level and memory.forces is None:
            velocity = self.views_of(self.level).x[: memory.tree.nv].copy()
        else:
            velocity = self._out[self._layout.velocity].copy()
        velocity.setflags(False)  # type: ignore[call-arg]  # as read_only does
        return velocity

    @property
    def forces(self) -> Array:
        """A copy of the contact forces (k,), in units of the QP."""
        if self.level:
            return self.views_of(self.level).x[self._memory.tree.nv :].copy()
        return self._out[self._layout.contact_forces].copy()

    @property
    def torque(self) -> Array:
        """A copy of the torques (nv - 6,) at the command [N m]."""
        return self._out[self._layout.torque].copy()

    @property
    def times(self) -> Times:
        """The tick up to the core's call, and the call: setting up the QP is a third of it."""
        return Times(self._call_time - self.start_time, 0.0, self.done - self._call_time)
