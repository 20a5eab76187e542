"""Plain ticks in the native core: from a snapshot to the QP, and maybe its solution, in one call.

Plain means one level, contacts met exactly, free braking and no singular threshold. Tasks that do
not describe their rows (:meth:`wbc.tasks.task.Task.native`) have theirs worked out in Python
(:mod:`wbc.controllers.native_given`). The QP is that of the Python tick to rounding, and all behind
it is shared. Whatever else comes, such as a joint outside its limits, is handed back: the same
snapshot then goes through the Python tick.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import TypeGuard

import numpy as np

from wbc.constraints.collision import SelfCollision
from wbc.constraints.limits import Limits
from wbc.controllers.contact_forces import NO_RAMPS
from wbc.controllers.levels import TOLERANCE
from wbc.controllers.native_forces import TorqueRows, unbearable
from wbc.controllers.native_given import GivenPart, GivenRows, may_be_given
from wbc.controllers.native_margin import NativeMargin
from wbc.controllers.native_memory import REDUCED, NativeMemory
from wbc.controllers.native_parts import Part
from wbc.controllers.native_problem import IN_CORE, Layout, NativeProblem
from wbc.controllers.plan import Plan
from wbc.qp.active_set import ActiveSet
from wbc.qp.backend import Backend
from wbc.qp.proxqp import Answered, ProxQP
from wbc.robot import Robot, Snapshot
from wbc.robot.kernel import NativeTree
from wbc.tasks.force_task import ForceTask
from wbc.tasks.task import Task
from wbc.validate import Array

_BY_CORE = Answered(IN_CORE, 1)
_LATER = object()  # of a snapshot that was not asked for anything yet


class NativePlan:
    """What the core needs of a controller; made anew with each plan.

    Its memory belongs to the controller; threads that share one take turns.

    Attributes
    ----------
    memory:
        What the core reads and works in.
    margin:
        Between the robot's bodies, kept by the core; None: none is.
    given:
        Tasks about motion whose rows are worked out in Python; all about forces are.
    shares_state:
        See :meth:`of`.
    """

    def __init__(
        self,
        robot: Robot,
        tree: NativeTree,
        plan: Plan,
        parts: Sequence[Part],
        limits: Limits | None,
        dt: float,
        backend: Backend | None,
        rows: TorqueRows | None,
        constraint: SelfCollision | None,
        margin: NativeMargin | None,
        shares_state: bool,
    ) -> None:
        tasks = [part.task for part in parts if not part.held]
        self._made_of = robot, tasks, plan, limits, dt, backend, rows, constraint
        self._given = [part for part in parts if isinstance(part, GivenPart)]
        given = (part.task for part in self._given)
        self.given = tuple(task for task in given if not isinstance(task, ForceTask))
        self._plan, self._parts, self._dt, self._lock = plan, parts, dt, threading.Lock()
        self._limits, self._rates = limits, _rates(limits)
        self._workspace = False, *plan.workspace  # as LevelSolver's
        self._solver = solver = backend if solves(backend) else None
        self.margin = margin
        self.memory = NativeMemory(robot, tree, plan, parts, limits, dt, rows, margin, solver)
        ends = np.cumsum([0, *(len(task.rows) for task in tasks)]).tolist()
        names = [task.name for task in tasks]
        errors = dict(zip(names, map(slice, ends, ends[1:]), strict=False))
        self._layout = Layout(self.memory, self.memory.answer, errors, plan.labels[0])
        self.shares_state = shares_state

    @classmethod
    def of(
        cls,
        robot: Robot,
        tasks: Sequence[Task],
        plan: Plan,
        limits: Limits | None,
        dt: float,
        backend: Backend | None = None,
        rows: TorqueRows | None = None,
        constraint: SelfCollision | None = None,
        shares_state: bool = False,
    ) -> NativePlan | None:
        """Return the plan of plain ticks, or None: the core is not there, or does not know all.

        Parameters
        ----------
        backend:
            What solves the QP as it is. None: it is not solved here.
        rows:
            What the torque level adds; None at the velocity level.
        constraint:
            What is kept apart by the core itself, which solves the QP then; None: nothing is.
        shares_state:
            Whether others in the tick look at what the core finds at a state: it is kept then.
        """
        passes = robot.native
        if passes is None or len(plan.levels) > 1 or plan.soft:
            return None
        if limits is not None and limits.braking != "free":
            return None
        if rows is not None and unbearable(rows, plan.held.contacts):
            return None
        torque = rows is not None
        parts = [Part(task, None, held=False, torque=torque) for task in tasks]
        unit, n = 0.0 if rows is None else rows.forces.unit, plan.decision.size
        for k, part in enumerate(parts):
            if part.rows is None and may_be_given(part.task, torque):
                parts[k] = GivenPart(part.task, torque, n, robot.nv, unit)
        for contact, kept in zip(plan.held.contacts, plan.held.kept, strict=True):
            chosen = None if kept is None else kept.tolist()
            parts.append(Part(contact, chosen, held=True, torque=torque))
        if any(part.rows is None for part in parts):
            return None
        margin = None if constraint is None else NativeMargin.of(constraint, passes.tree)
        if constraint is not None and margin is None:
            return None
        made_of = robot, passes.tree, plan, parts, limits, dt, backend, rows, constraint, margin
        return cls(*made_of, shares_state)

    def __reduce__(self) -> tuple[object, ...]:
        # A copy has memory of its own.
        return type(self).of, (*self._made_of, self.shares_state)

    def serves(self, limits: Limits | None, dt: float) -> bool:
        """Whether limits and time step are still those that the plan was made for."""
        return (
            dt == self._dt
            and limits is self._limits
            and (limits is None or limits.braking == "free")
            and (self.margin is None or self.margin.serves())
        )

    def problem(
        self,
        snapshot: Snapshot,
        ramps: Mapping[str, float] = NO_RAMPS,
        given: Sequence[GivenRows] = (),
        begun: float | None = None,
    ) -> NativeProblem | None:
        """Return the QP at ``snapshot``, maybe solved; None: to be done in Python.

        Parameters
        ----------
        ramps:
            The largest normal forces [N] of contacts that come or go.
        given:
            The rows of the tasks ``given``, and behind them of those about forces, in their order.
        begun:
            When the tick began [s]; None: now.
        """
        if begun is None:
            begun = perf_counter()
        if self.shares_state:
            known = snapshot.native_state
        else:
            known = snapshot.__dict__.get("native_state", _LATER)
        if known is None:  # a copy from elsewhere
            return None
        state = None if known is _LATER else known.array
        with self._lock:
            if not self._write(ramps):
                return None
            for part, rows in zip(self._given, given, strict=True):
                if not part.fill(rows):
                    return None
            called = perf_counter()
            said, out = self.memory.call(snapshot.measured, state)
            answered = _BY_CORE
            if said == REDUCED and isinstance(self._solver, ProxQP):
                memory = self.memory
                bounded = memory.forces is not None
                found = self._solver.solve_reduced(memory, self._workspace, bounded)
                said, answered = self.memory.said, found or answered
            done = perf_counter()
            if said > 0:
                return None
            asked = self._solver is not None
            by = answered if asked and said == 0 else None
            problem = NativeProblem(self._layout, out, begun, called, done, by, asked)
            if given:
                problem.given = given
            return problem

    def _write(self, ramps: Mapping[str, float]) -> bool:
        """Write what has changed since the last tick; False if that needs another plan."""
        forces, limits = self.memory.forces, self._limits
        if limits is not None:
            speed, acceleration = self._rates
            if limits.speed is not speed or limits.acceleration is not acceleration:
                self.memory.write_limits(limits)
                self._rates = _rates(limits)
        for part in self._parts:
            task = part.task
            if task._changes != part.changes or task._assigned != part.assigned:
                if forces is not None and part.held:
                    forces.stale = True
                if not part.write(self._dt):
                    return False
        return forces is None or forces.write(ramps)


def solves(backend: Backend | None) -> TypeGuard[ActiveSet | ProxQP]:
    """Whether a tick stays with the core until it is solved: by itself, or with ProxQP's aid.

    A command may exceed limits by no more than its residuals.
    """
    if not isinstance(backend, ActiveSet | ProxQP) or backend.eps > TOLERANCE:
        return False
    return type(backend) is ActiveSet or (type(backend) is ProxQP and backend.warm)


def _rates(limits: Limits | None) -> tuple[Array | None, Array | None]:
    """Return what the core was told of the limits that may be assigned, compared by identity."""
    return (None, None) if limits is None else (limits.speed, limits.acceleration)
