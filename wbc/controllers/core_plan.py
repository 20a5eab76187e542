"""Ticks in the core: from a snapshot to the solutions of all levels' QPs.

A plan holds what does not change between ticks. Python evaluates the tasks that do not describe
their rows (:meth:`wbc.tasks.task.Task.native`), and all constraints but self-collision; the core
computes everything else from the state to the QP.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import TypeGuard

import numpy as np

from wbc.constraints.collision import SelfCollision
from wbc.constraints.contact import Contact
from wbc.constraints.limits import Limits
from wbc.constraints.rows import Bounds
from wbc.controllers.blocks import ForcePart, Part, PythonPart, TaskEvaluation
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
    """A controller's parts as the core reads them; made anew with each plan.

    Its memory belongs to the controller; threads that share one take turns.

    ``tasks``, ``forces``: motion tasks and force tasks.
    ``rows``: the torque level's rows; None at the velocity level.
    ``constraint``: the self-collision margin that the core evaluates; None if there is none.
    ``modifies_qps``: whether the QPs of levels are changed in Python before they are solved.
    ``needs_state``: whether other parts of the tick read the kinematic state: the snapshot keeps it
    then.
    ``error_offset``: (held,) added to the errors of loops and gears.
    ``curved``: names of tasks in Python whose residuals have a curvature.

    ``memory``: the core's inputs and scratch.
    ``margin``: the self-collision margin in the core, or None.
    ``python_tasks``: motion tasks, soft contacts and contacts that Python evaluates.
    ``force_tasks``: force tasks that Python evaluates.
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
        modifies_qps: bool,
        needs_state: bool,
        soft_weights: Mapping[str, float],
        curved: frozenset[str],
        error_offset: Array,
    ) -> None:
        tree = robot.native.tree
        self._arguments = (
            *(robot, tasks, forces, plan, limits, dt, backend, rows, constraint),
            *(modifies_qps, needs_state, soft_weights, curved, error_offset),
        )
        torque, n = rows is not None, plan.decision.size
        self._parts: list[Part] = []
        for k, task in enumerate((*tasks, *plan.soft, *forces)):
            level = next(i for i, members in enumerate(plan.levels) if k in members)
            scale = float(np.sqrt(soft_weights[task.name])) if task in plan.soft else 1.0
            self._parts.append(Part(task, None, False, torque, level, scale))
        for contact, kept in zip(plan.held.contacts, plan.held.row_selections, strict=True):
            chosen = None if kept is None else kept.tolist()
            self._parts.append(Part(contact, chosen, held=True, torque=torque))
        for k, part in enumerate(self._parts):
            if part.rows is None and isinstance(part.task, ForceTask):
                self._parts[k] = ForcePart(part, n)
            elif part.rows is None:
                self._parts[k] = PythonPart(part, robot.nv, part.task.name in curved)
        asked = [part for part in self._parts if isinstance(part, PythonPart | ForcePart)]
        self._python_parts = {id(part.task): part for part in asked}
        self.python_tasks = tuple(part.task for part in asked if isinstance(part, PythonPart))
        self.force_tasks = tuple(one for one in forces if id(one) in self._python_parts)
        self.plan, self._robot = plan, robot
        self._dt, self._lock = dt, threading.Lock()
        self._limits, self._limits_changes = limits, limits and limits._changes
        self._solver = solver = backend if core_solves(backend) else None
        self.margin = None if constraint is None else NativeMargin.of(constraint, tree)
        made_of = robot, tree, plan, self._parts, limits, dt, rows, self.margin
        self.memory = CoreMemory(*made_of, solver, error_offset, modifies_qps)
        costs = (*tasks, *plan.soft, *forces)
        ends = np.cumsum([0, *(len(task.rows) for task in costs)]).tolist()
        errors = {
            task.name: slice(begin, end)
            for task, begin, end in zip(costs, ends, ends[1:], strict=False)
            if task not in plan.soft
        }
        level_names = [
            f"level {k}: {', '.join(costs[i].name for i in members)}"
            for k, members in enumerate(plan.levels)
        ]
        self._names = TickNames(errors, plan.labels, level_names)
        self._costs, self._ends = costs, ends
        self.needs_state, self._braking = needs_state, limits and limits.braking
        # Decelerations of the torque level's rows were made of these accelerations.
        self._accelerations = limits.acceleration if torque and limits is not None else None

    def __reduce__(self) -> tuple[object, ...]:
        return type(self)._with_preferred_columns, (*self._arguments, self.memory.preferred_columns)

    @classmethod
    def _with_preferred_columns(cls, *parts: object) -> CorePlan:
        """Return a copy with its own memory."""
        *arguments, columns = parts
        made = cls(*arguments)  # type: ignore[arg-type]
        made.memory.preferred_columns = columns  # type: ignore[assignment]
        return made

    @property
    def solves(self) -> bool:
        """Whether the core solves the first level, alone or with ProxQP."""
        return self._solver is not None

    @property
    def heaviest(self) -> float:
        """Square of the largest weight of a cost."""
        costs = (part for part in self._parts if not part.held)
        weights = [views.weight for part in costs for views in part._views]
        return max(map(largest, weights)) ** 2

    def changed(self) -> str | None:
        """Return which task was changed since it was last written, in words, or None."""
        for part in self._parts:
            task = part.task
            if task._changes is not part.changes:
                return f"{task.name!r} was changed since"
        return None

    def is_current(self, limits: Limits | None, dt: float) -> bool:
        """Return whether limits and time step are still those that the plan was made for."""
        return (
            dt == self._dt
            and limits is self._limits
            and (limits is None or limits.braking == self._braking)
            and (
                limits is None
                or self._accelerations is None
                or limits.acceleration is self._accelerations
            )
            and (self.margin is None or self.margin.is_current())
        )

    def tick(
        self,
        snapshot: Snapshot,
        evaluations: Sequence[TaskEvaluation] = (),
        bounds: Bounds | None = None,
        ramps: Mapping[str, float] = NO_RAMPS,
        start_time: float | None = None,
        solve: bool = True,
    ) -> CoreTick | None:
        """Return the QPs at ``snapshot``, maybe solved; None: the plan has to be made anew.

        ``evaluations``: residuals of the tasks that Python evaluates.
        ``bounds``: inequality rows of the constraints that Python evaluates.
        ``ramps``: the largest normal forces [N] of contacts that come or go.
        ``start_time``: when the tick began [s]; None: now.
        ``solve``: False: set up the first level's QP and solve nothing.
        """
        if start_time is None:
            start_time = perf_counter()
        known: NativeState | None = snapshot.__dict__.get("native_state")
        if known is None and self.needs_state:
            known = snapshot.native_state
        state = None if known is None else known.array
        memory = self.memory
        with self._lock:
            if not self._write(ramps):
                return None
            for one in evaluations:
                if not self._python_parts[id(one.task)].fill(one):
                    return None
            if memory.forces is not None:
                memory.forces.write_load(self._robot, snapshot)
            if bounds is not None or memory.given_rows:
                memory.write_bounds(bounds)
            call_time = perf_counter()
            status = memory.call(snapshot.measured, state, solve and self._solver is not None)
            core_tick = CoreTick(memory, self._names, start_time, call_time)
            if evaluations:
                core_tick.evaluations = evaluations
            if bounds is not None:
                core_tick.with_bounds(bounds)
            if solve and status == REDUCED:  # ProxQP solves the reduced QP
                status = memory.descend() if self._solve_by_proxqp(core_tick) else memory.status
            core_tick.solved = solve and status == DONE and self._solver is not None
            core_tick.done = perf_counter()
            return core_tick

    def solve_level(self, core_tick: CoreTick, level: int) -> bool:
        """Solve a level of a tick that was set up, once its QP has been modified."""
        with self._lock:
            if level == 0 and self._solver is None:
                return False
            status = self.memory.solve_level(level)
            return self._solve_by_proxqp(core_tick) if status == REDUCED else status == DONE

    def _solve_by_proxqp(self, core_tick: CoreTick) -> bool:
        """Solve the first level, whose QP the core has reduced, by ProxQP."""
        if not isinstance(self._solver, ProxQP):
            return False
        bounded = self.memory.forces is not None
        call = self._solver.solve_reduced(self.memory, self.plan.workspace, bounded)
        core_tick.first_call = call
        return call is not None

    def cost_rows(self, core_tick: CoreTick, level: int) -> list[tuple[Task, Rows]]:
        """Return the rows of a level's costs: views on the core's memory."""
        memory, nv = self.memory, self.memory.tree.nv
        n, costs, stored = memory.n, memory.costs, memory.arrays["rows"]
        matrix = stored[: costs * n].reshape(costs, n)[:, :nv]
        target, bias = stored[costs * n : costs * (n + 2)].reshape(2, costs)
        rows = []
        for k in self.plan.levels[level]:
            task, where = self._costs[k], slice(self._ends[k], self._ends[k + 1])
            views = self._parts[k]._views
            weight = np.concatenate([one.weight for one in views])
            rate = 0.0 if isinstance(task, ForceTask) else float(views[0].header[0])
            threshold = task.law.singular_threshold
            one = Rows(matrix[where], target[where], weight, threshold, rate, bias[where])
            rows.append((task, one))
        return rows

    def _write(self, ramps: Mapping[str, float]) -> bool:
        """Write what has changed since the last tick; False if that needs a new plan."""
        forces, limits = self.memory.forces, self._limits
        if limits is not None and limits._changes is not self._limits_changes:
            self.memory.write_limits(limits)
            self._limits_changes = limits._changes
        for part in self._parts:
            if part.own["_changes"] is not part.changes:
                if forces is not None and isinstance(part.task, Contact):
                    forces.stale = True
                if not part.write(self._dt):
                    return False
        return forces is None or forces.write(ramps)


def core_solves(backend: Backend | None) -> TypeGuard[ActiveSet | ProxQP]:
    """Return whether the core runs the whole tick, alone or with ProxQP on the reduced QP.

    Only with a solver whose residuals, by which a command may exceed limits, are small enough.
    """
    if not isinstance(backend, ActiveSet | ProxQP) or backend.eps > TOLERANCE:
        return False
    return type(backend) is ActiveSet or (type(backend) is ProxQP and backend.warm)
