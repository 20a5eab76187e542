"""What the core made of one snapshot: the QPs of its levels, and their solutions.

All of it lies in one array. A tick needs the command alone, and most are never asked for more, so
the rest becomes objects when it is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wbc.constraints.rows import Bounds
from wbc.controllers.blocks import Asked
from wbc.controllers.core_layout import LevelViews
from wbc.controllers.core_memory import CoreMemory
from wbc.controllers.singular import Singularity
from wbc.controllers.slack import NEGLIGIBLE, GivingQP
from wbc.controllers.tick import Times
from wbc.laws import Residual
from wbc.qp.active_set import NAME
from wbc.qp.problem import QP, Labels
from wbc.qp.proxqp import Answered
from wbc.qp.solution import KktResiduals, Solution, Status
from wbc.validate import Array, read_only

_NONE: Array = read_only(np.zeros(0))
# Who answers where the optimum of the cost alone keeps all bounds and rows: no solver.
NO_SOLVER = "cholesky"


class TickNames(NamedTuple):
    """What is the same in every tick of a plan."""

    errors: dict[str, slice]  # of each task, by name: where its error is among all
    labels: Sequence[Labels]  # of each level's QP; those of inequality rows come with the tick
    levels: Sequence[str]  # what levels are called where they are left out


class CoreTick:
    """The QPs of a tick, and their checked solutions.

    Parameters
    ----------
    begun, called, done:
        When the tick began, when the core was called, and when it was done [s].

    Attributes
    ----------
    given:
        What tasks in Python answered.
    solved:
        Whether there is a command.
    answered:
        Who solved the first level; None: the core, which says by its iterations who.
    first:
        The first level's solution where it was found outside the core.
    hurried:
        What was left out: there was no time for it, or no answer.
    relaxed:
        The QP in which only physics is hard, where the other had no solution.
    """

    status, policy = Status.SOLVED, None
    answered: Answered | None = None
    first: Solution | None = None
    relaxed: GivingQP | None = None
    hurried: tuple[str, ...] = ()
    solved = False
    given: Sequence[Asked] = ()
    _forced: tuple[str, ...] = ()  # names of the level's own rows, as they are in this tick
    _rows: tuple[str, ...] = ()
    _slack_weights: Array | None = None
    done: float

    def __init__(self, memory: CoreMemory, names: TickNames, begun: float, called: float) -> None:
        self._memory, self._names, self._layout = memory, names, memory.layout
        self._out, self._below, self._given_rows = memory.out, memory.below, memory.given_rows
        self.begun, self._called = begun, called
        if memory.forces is not None:
            self._forced = memory.forces.labels

    def with_bounds(self, bounds: Bounds) -> None:
        """Take note of the names of the inequality rows of constraints in Python, and slacks."""
        self._rows, self._slack_weights = bounds.labels, bounds.slack

    @cached_property
    def singular(self) -> dict[str, Singularity]:
        """What was found of each task with a singular threshold."""
        return {}

    def take(self, solution: Solution) -> None:
        """Let a first level's answer from outside the core be that of the tick."""
        a, n = self.views, self.views.x.size
        a.x[:], a.y[:], a.z[:] = solution.x[:n], solution.y, solution.z
        a.z_box[:] = solution.z_box[:n]
        a.found[:3], a.found[3:] = solution.residuals, (solution.iterations, 1.0)
        self.first = solution

    def take_over(self, other: CoreTick) -> None:
        """Let this be what ``other`` is: of the same snapshot, in other memory."""
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
    def left_out(self) -> tuple[str, ...]:
        """Levels that were not solved, and what there was no time for."""
        return (*self._names.levels[self.level + 1 :], *self.hurried)

    @cached_property
    def views(self) -> LevelViews:
        """The first level, and what is known of the tick."""
        return self._layout.read(self._out, self._below)

    def views_of(self, level: int) -> LevelViews:
        """Return the views on a level: of those below the first on the last that was posed."""
        if level == 0:
            return self.views
        layout = self._memory.layout_of(level, self._given_rows)
        return layout.read(self._out, self._below)

    def qp_of(self, level: int) -> QP:
        """Return the QP of a level, without slacks; see :meth:`views_of`."""
        a, labels, rows = self.views_of(level), self._names.labels[level], self._forced
        margin = self._memory.margin
        if margin is not None:
            rows += margin.labels(a.chosen)
        rows += self._rows
        if rows:
            labels = Labels(labels.equality, rows, labels.variables)
        return QP(a.P, a.g, a.A, a.b, a.C, a.l, a.u, a.lower, a.upper, labels)

    @cached_property
    def qp(self) -> QP:
        """That of the last level that was solved, or the relaxed one."""
        if self.relaxed is not None:
            return self.relaxed.qp
        return self.qp_of(self.level)

    @property
    def box(self) -> tuple[Array, Array]:
        """The bounds (nv,), (nv,) on the velocity that the first level keeps."""
        nv = self._memory.tree.nv
        return self.views.lower[:nv], self.views.upper[:nv]

    @property
    def slack_weights(self) -> Array | None:
        """Weights (m,) of the slacks of all inequality rows, infinite of hard ones; None: all."""
        if self._slack_weights is None:
            return None
        weights = np.full(self._layout.sizes[2], np.inf)
        weights[weights.size - self._slack_weights.size :] = self._slack_weights
        return weights

    @property
    def slack(self) -> dict[str, float]:
        """By how much rows gave way that may, by name."""
        weights = self._slack_weights
        if weights is None:
            return {}
        slack = self.views_of(self.level).z[-weights.size :] / weights
        missed = np.flatnonzero(np.abs(slack) > NEGLIGIBLE)
        return {self._rows[k]: float(slack[k]) for k in missed.tolist()}

    @cached_property
    def errors(self) -> dict[str, Array]:
        """Error of each task, by name."""
        every = self.views.errors.copy()  # may be kept longer than the QP
        return {name: every[where] for name, where in self._names.errors.items()}

    def residual(self, name: str) -> Residual:
        """Return the residual of a task, without derivatives where the core worked it out."""
        for one in self.given:
            if one.task.name == name and one.residual is not None:
                return one.residual
        return Residual(self.errors[name], _NONE, _NONE)

    # ------------------------------------------------------------------ the answers

    @cached_property
    def solution(self) -> Solution:
        """The answer of the last level that was solved."""
        level = self.level
        if level == 0 and self.first is not None:
            return self.first
        return self._solution(level)

    def _solution(self, level: int) -> Solution:
        a, by = self.views_of(level), self.answered if level == 0 else None
        *residuals, iterations, _ = a.found.tolist()
        if by is None:
            by = Answered(NAME if iterations else NO_SOLVER, 1)
        known, spent = KktResiduals(*residuals), self.done - self._called
        done = Status.SOLVED, known, int(iterations), spent, by.solver, None, by.attempts
        return Solution(a.x.copy(), a.y.copy(), a.z.copy(), a.z_box.copy(), *done)

    @property
    def velocity(self) -> Array:
        """A copy, read-only, of the command v+ (nv,), with the base's dynamics met where it has."""
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
        return Times(self._called - self.begun, 0.0, self.done - self._called)
