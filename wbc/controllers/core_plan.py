"""Ticks in the core: from a snapshot to the answers of all levels' QPs.

A plan is what does not change between ticks. Tasks that do not describe their rows
(:meth:`wbc.tasks.task.Task.native`) are asked in Python, and so are constraints but the margin
between a robot's bodies; all else from the state to the QP is the core's.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import TypeGuard

import numpy as np

from wbc.constraints.collision import SelfCollision
from wbc.constraints.limits import Limits
from wbc.constraints.rows import Bounds
from wbc.controllers.blocks import Asked, AskedPart, ForcePart, Part
from wbc.controllers.contact_forces import NO_RAMPS
from wbc.controllers.core_memory import DONE, REDUCED, CoreMemory
from wbc.controllers.core_tick import CoreTick, TickNames
from wbc.controllers.force_rows import TorqueRows
from wbc.controllers.margin_rows import NativeMargin
from wbc.controllers.plan import LevelPlan
from wbc.laws import Rows
from wbc.qp.active_set import ActiveSet
from wbc.qp.backend import Backend
from wbc.qp.kkt import largest
from wbc.qp.proxqp import ProxQP
from wbc.robot import Robot, Snapshot
from wbc.robot.kernel import NativeState
from wbc.tasks.force_task import ForceTask
from wbc.tasks.task import Task
from wbc.validate import Array

# A command may exceed a bound of its box by this [rad/s or m/s]: what accepted solutions leave.
TOLERANCE = 1e-6


class CorePlan:
    """What the core needs of a controller; made anew with each plan.

    Its memory belongs to the controller; threads that share one take turns.

    Parameters
    ----------
    tasks, forces:
        Those about motion, and those about forces.
    rows:
        What the torque level adds; None at the velocity level.
    constraint:
        What is kept apart by the core itself; None: nothing is.
    looked_into:
        Whether others change the QPs of levels before they are solved.
    shares_state:
        Whether others in the tick look at what the core finds at a state: it is kept then.
    added:
        (held,) what is added to the errors of loops and gears.
    curved:
        Tasks in Python whose residuals have a curvature, by name.

    Attributes
    ----------
    memory:
        What the core reads and works in.
    margin:
        Between the robot's bodies, kept by the core; None: none is.
    python_tasks:
        Tasks about motion, soft contacts and contacts that are asked in Python.
    force_tasks:
        Those about forces that are.
    """

    def __init__(
        self,
        robot: Robot,
        tasks: Sequence[Task],
        forces: Sequence[ForceTask],
        plan: LevelPlan,
        limits: Limits | None,
        dt: float,
        backend: Backend,
        rows: TorqueRows | None,
        constraint: SelfCollision | None,
        looked_into: bool,
        shares_state: bool,
        soft_weights: Mapping[str, float],
        curved: frozenset[str],
        added: Array,
    ) -> None:
        tree = robot.native.tree
        self._made_of = (
            *(robot, tasks, forces, plan, limits, dt, backend, rows, constraint),
            *(looked_into, shares_state, soft_weights, curved, added),
        )
        torque, n = rows is not None, plan.decision.size
        self._parts: list[Part] = []
        for k, task in enumerate((*tasks, *plan.soft, *forces)):
            level = next(i for i, members in enumerate(plan.levels) if k in members)
            scale = float(np.sqrt(soft_weights[task.name])) if task in plan.soft else 1.0
            self._parts.append(Part(task, None, False, torque, level, scale))
        for contact, kept in zip(plan.held.contacts, plan.held.kept, strict=True):
            chosen = None if kept is None else kept.tolist()
            self._parts.append(Part(contact, chosen, held=True, torque=torque))
        for k, part in enumerate(self._parts):
            if part.rows is None and isinstance(part.task, ForceTask):
                self._parts[k] = ForcePart(part, n)
            elif part.rows is None:
                self._parts[k] = AskedPart(part, robot.nv, part.task.name in curved)
        asked = [part for part in self._parts if isinstance(part, AskedPart | ForcePart)]
        self._asked = {id(part.task): part for part in asked}
        self.python_tasks = tuple(part.task for part in asked if isinstance(part, AskedPart))
        self.force_tasks = tuple(one for one in forces if id(one) in self._asked)
        self.plan, self._robot = plan, robot
        self._dt, self._lock = dt, threading.Lock()
        self._limits, self._limits_changes = limits, limits and limits._changes
        self._solver = solver = backend if solves(backend) else None
        self.margin = None if constraint is None else NativeMargin.of(constraint, tree)
        made_of = robot, tree, plan, self._parts, limits, dt, rows, self.margin
        self.memory = CoreMemory(*made_of, solver, added, looked_into)
        costs = (*tasks, *plan.soft, *forces)
        ends = np.cumsum([0, *(len(task.rows) for task in costs)]).tolist()
        errors = {
            task.name: slice(begin, end)
            for task, begin, end in zip(costs, ends, ends[1:], strict=False)
            if task not in plan.soft
        }
        called = [
            f"level {k}: {', '.join(costs[i].name for i in members)}"
            for k, members in enumerate(plan.levels)
        ]
        self._names = TickNames(errors, plan.labels, called)
        self._costs, self._ends = costs, ends
        self.shares_state, self._braking = shares_state, limits and limits.braking

    def __reduce__(self) -> tuple[object, ...]:
        return type(self)._with_columns, (*self._made_of, self.memory.last_pivots)

    @classmethod
    def _with_columns(cls, *parts: object) -> CorePlan:
        """Return a copy, with memory of its own."""
        *made_of, last_pivots = parts
        made = cls(*made_of)  # type: ignore[arg-type]
        made.memory.last_pivots = last_pivots  # type: ignore[assignment]
        return made

    @property
    def solves(self) -> bool:
        """Whether the first level is solved in the core, or with its aid."""
        return self._solver is not None

    @property
    def heaviest(self) -> float:
        """Square of the heaviest weight of a cost."""
        costs = (part for part in self._parts if not part.held)
        weights = [place.weight for part in costs for place in part._places]
        return max(map(largest, weights)) ** 2

    def changed(self) -> str | None:
        """Return which task was changed since it was last written, in words, or None."""
        for part in self._parts:
            task = part.task
            if task._changes is not part.changes:
                return f"{task.name!r} was changed since"
        return None

    def serves(self, limits: Limits | None, dt: float) -> bool:
        """Whether limits and time step are still those that the plan was made for."""
        return (
            dt == self._dt
            and limits is self._limits
            and (limits is None or limits.braking == self._braking)
            and (self.margin is None or self.margin.serves())
        )

    def tick(
        self,
        snapshot: Snapshot,
        given: Sequence[Asked] = (),
        bounds: Bounds | None = None,
        ramps: Mapping[str, float] = NO_RAMPS,
        begun: float | None = None,
        solve: bool = True,
    ) -> CoreTick | None:
        """Return the QPs at ``snapshot``, maybe solved; None: the plan has to be made anew.

        Parameters
        ----------
        given:
            What tasks in Python answered.
        bounds:
            Inequality rows of constraints that were.
        ramps:
            The largest normal forces [N] of contacts that come or go.
        begun:
            When the tick began [s]; None: now.
        solve:
            False: the first level's QP is set up, and nothing is solved.
        """
        if begun is None:
            begun = perf_counter()
        known: NativeState | None = snapshot.__dict__.get("native_state")
        if known is None and self.shares_state:
            known = snapshot.native_state
        state = None if known is None else known.array
        memory = self.memory
        with self._lock:
            if not self._write(ramps):
                return None
            for one in given:
                if not self._asked[id(one.task)].fill(one):
                    return None
            if memory.forces is not None:
                memory.forces.write_load(self._robot, snapshot)
            if bounds is not None or memory.given_rows:
                memory.write_bounds(bounds)
            called = perf_counter()
            said = memory.call(snapshot.measured, state, solve and self._solver is not None)
            found = CoreTick(memory, self._names, begun, called)
            if given:
                found.given = given
            if bounds is not None:
                found.with_bounds(bounds)
            if solve and said == REDUCED:  # ProxQP is to answer it
                said = memory.descend() if self._is_answered(found) else memory.said
            found.solved = solve and said == DONE and self._solver is not None
            found.done = perf_counter()
            return found

    def solve_level(self, found: CoreTick, level: int) -> bool:
        """Solve a level of a tick that was set up, after others looked into its QP."""
        with self._lock:
            if level == 0 and self._solver is None:
                return False
            said = self.memory.solve_level(level)
            return self._is_answered(found) if said == REDUCED else said == DONE

    def _is_answered(self, found: CoreTick) -> bool:
        """Ask ProxQP for the first level, whose QP the core has reduced."""
        if not isinstance(self._solver, ProxQP):
            return False
        bounded = self.memory.forces is not None
        found.answered = self._solver.solve_reduced(self.memory, self.plan.workspace, bounded)
        return found.answered is not None

    def rows_of(self, found: CoreTick, level: int) -> list[tuple[Task, Rows]]:
        """Return the rows of a level's costs: views on what the core keeps of them."""
        memory, nv = self.memory, self.memory.tree.nv
        n, costs, kept = memory.n, memory.costs, memory.arrays["rows"]
        matrix = kept[: costs * n].reshape(costs, n)[:, :nv]
        target, bias = kept[costs * n : costs * (n + 1)], kept[costs * (n + 1) : costs * (n + 2)]
        rows = []
        for k in self.plan.levels[level]:
            task, where = self._costs[k], slice(self._ends[k], self._ends[k + 1])
            places = self._parts[k]._places
            weight = np.concatenate([place.weight for place in places])
            rate = 0.0 if isinstance(task, ForceTask) else float(places[0].header[0])
            threshold = task.law.singular_threshold
            one = Rows(matrix[where], target[where], weight, threshold, rate, bias[where])
            rows.append((task, one))
        return rows

    def _write(self, ramps: Mapping[str, float]) -> bool:
        """Write what has changed since the last tick; False if that needs another plan."""
        forces, limits = self.memory.forces, self._limits
        if limits is not None and limits._changes is not self._limits_changes:
            self.memory.write_limits(limits)
            self._limits_changes = limits._changes
        for part in self._parts:
            if part.own["_changes"] is not part.changes:
                task = part.task
                if (task.name, task.priority) != part.planned_as:
                    return False
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
