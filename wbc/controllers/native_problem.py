"""What the native core made of one snapshot: its QP, and maybe the QP's solution.

All of it lies in one array. A tick needs the command alone, and most are never asked for more, so
the rest becomes objects when it is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wbc.constraints.rows import Bounds
from wbc.controllers.native_answer import Answer, AnswerLayout
from wbc.controllers.native_given import GivenRows
from wbc.controllers.native_memory import NativeMemory
from wbc.controllers.plan import Assembled
from wbc.controllers.singular import Singularity
from wbc.controllers.tick import Times
from wbc.laws import Residual
from wbc.qp.active_set import NAME
from wbc.qp.problem import QP, Labels
from wbc.qp.proxqp import Answered
from wbc.qp.solution import KktResiduals, Solution, Status
from wbc.validate import Array, read_only

_NONE: Array = read_only(np.zeros(0))
# Who answered in the call that made the QP: the active-set method, or, where the optimum of the
# cost alone keeps all bounds and rows, no solver; by the iterations it is told which.
IN_CORE = "core"
NO_SOLVER = "cholesky"


class Layout(NamedTuple):
    """What is the same in every tick of a plan.

    Attributes
    ----------
    answer:
        Where what the core writes lies.
    errors:
        Of each task, by name: where its error is among all.
    labels:
        Of the QP; at the torque level inequality rows have others, which contacts may change.
    """

    memory: NativeMemory
    answer: AnswerLayout
    errors: dict[str, slice]
    labels: Labels


class NativeProblem:
    """A QP, what diagnostics want to know of the tasks, and maybe the QP's checked solution.

    Parameters
    ----------
    out:
        What the core wrote, in memory that nobody else holds.
    begun, called, done:
        When the tick began, when the core was called, and when it was done [s].

    answered:
        Who solved it, if the core found the residuals small enough to need no second look.
    asked:
        Whether somebody was asked to solve it.

    Attributes
    ----------
    solved:
        Whether it has a solution.
    given:
        Rows that were worked out in Python.
    """

    # What a plain tick, which is one of a solved QP, says of itself besides.
    status, policy = Status.SOLVED, None
    given: Sequence[GivenRows] = ()

    def __init__(
        self,
        layout: Layout,
        out: Array,
        begun: float,
        called: float,
        done: float,
        answered: Answered | None,
        asked: bool,
    ) -> None:
        self._layout, self._out = layout, out
        self.begun, self._called, self._done = begun, called, done
        forces = layout.memory.forces
        self._forced = None if forces is None else forces.labels  # these of this tick
        self._answered, self._asked = answered, asked
        self.solved = answered is not None

    @cached_property
    def _answer(self) -> Answer:
        return self._layout.answer.read(self._out)

    # ------------------------------------------------------------------ the problem

    @cached_property
    def qp(self) -> QP:
        """The QP; rows of margins are in it where the core made them."""
        a, labels, margin = self._answer, self._layout.labels, self._layout.memory.margin
        rows = self._forced or ()
        if margin is not None:
            rows += margin.labels(a.chosen)
        if rows:
            labels = Labels(labels.equality, rows, labels.variables)
        return QP(a.P, a.g, a.A, a.b, a.C, a.l, a.u, a.lower, a.upper, labels)

    @property
    def assembled(self) -> Assembled:
        """The same, as rows of margins are added to it."""
        return Assembled(self.qp, float(self._answer.heaviest[0]))

    @cached_property
    def bounds(self) -> Bounds | None:
        """The inequality rows at the torque level, else None."""
        if self._forced is None:
            return None
        return Bounds(self._forced, self._answer.C, self._answer.l, self._answer.u)

    @property
    def matrix(self) -> Array:
        """Base forces and torques by the unknowns (nv, n), at the torque level."""
        return self._answer.D

    @property
    def offset(self) -> Array:
        """The same at zero unknowns (nv,)."""
        return self._answer.offset

    @property
    def slack(self) -> dict[str, float]:
        """Nothing gave way."""
        return {}

    @property
    def singular(self) -> dict[str, Singularity]:
        """No task has a threshold."""
        return {}

    @cached_property
    def errors(self) -> dict[str, Array]:
        """Error of each task, by name."""
        every = self._answer.errors.copy()  # may be kept longer than the QP
        return {name: every[where] for name, where in self._layout.errors.items()}

    def residual(self, name: str) -> Residual:
        """Return the residual of a task, without derivatives where the core worked it out."""
        for one in self.given:
            if one.name == name and one.residual is not None:
                return one.residual
        return Residual(self.errors[name], _NONE, _NONE)

    # ------------------------------------------------------------------ its solution

    @cached_property
    def solution(self) -> Solution | None:
        """The answer; None if none was asked for, or its residuals are not small enough."""
        by, a = self._answered, self._answer
        if by is None:
            return None
        if by.solver == IN_CORE:
            by = Answered(NAME if a.found[-1] else NO_SOLVER, 1)
        *residuals, iterations = a.found.tolist()
        x, y, z, z_box = (part.copy() for part in (a.x, a.y, a.z, a.z_box))
        known, spent = KktResiduals(*residuals), self._done - self._called
        done = Status.SOLVED, known, int(iterations), spent, by.solver, None, by.attempts
        return Solution(x, y, z, z_box, *done)

    @property
    def velocity(self) -> Array:
        """A copy, read-only, of the command v+ (nv,), with the base's dynamics met where it has."""
        velocity = self._out[self._layout.answer.velocity].copy()
        velocity.setflags(False)  # type: ignore[call-arg]  # as read_only does
        return velocity

    @property
    def forces(self) -> Array:
        """A copy of the contact forces (k,), in units of the QP."""
        return self._out[self._layout.answer.contact_forces].copy()

    @property
    def torque(self) -> Array:
        """A copy of the torques (nv - 6,) at the command [N m]."""
        return self._out[self._layout.answer.torque].copy()

    @property
    def times(self) -> Times:
        """The tick up to the core's call, and the call: setting up the QP is a third of it."""
        return Times(self._called - self.begun, 0.0, self._done - self._called)
