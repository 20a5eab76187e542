"""Plain ticks in the native core: from a snapshot to the QP, and maybe its solution, in one call.

Plain means one level, contacts met exactly, free braking, no singular threshold, and tasks that
describe their rows (:meth:`wbc.tasks.task.Task.native`), none of them about forces. The QP is that
of the Python tick to rounding, and all behind it is shared. Whatever else comes, such as a joint
outside its limits, is handed back: the same snapshot then goes through the Python tick.
"""

from __future__ import annotations

import operator
import threading
from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import NamedTuple

import numpy as np

from wbc.constraints.limits import Limits
from wbc.constraints.rows import Bounds
from wbc.controllers.contact_forces import NO_RAMPS
from wbc.controllers.native_forces import TorqueRows, unbearable
from wbc.controllers.native_memory import Answer, NativeMemory
from wbc.controllers.native_parts import Part
from wbc.controllers.plan import Assembled, Plan
from wbc.laws import Residual
from wbc.qp.backend import Backend
from wbc.qp.daqp import Daqp
from wbc.qp.daqp_direct import direct_daqp
from wbc.qp.native_daqp import accepted
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import Solution
from wbc.robot import Robot, Snapshot
from wbc.robot.kernel import NativeTree
from wbc.tasks.task import Task
from wbc.validate import Array, read_only

_NONE: Array = read_only(np.zeros(0))


class NativeProblem(NamedTuple):
    """A QP, what diagnostics want to know of the tasks, and maybe the QP's checked solution.

    Attributes
    ----------
    assembled:
        The QP as it is without margins.
    bounds:
        Its inequality rows at the torque level, else None.
    matrix, offset:
        Base forces and torques by the unknowns (nv, n), (nv,), at the torque level.
    command:
        Of the solution there: x (n,) that meets the base's dynamics to rounding, and torques.
    """

    assembled: Assembled
    residuals: list[Residual]
    bounds: Bounds | None
    matrix: Array
    offset: Array
    solution: Solution | None
    command: tuple[Array, Array] | None

    @property
    def qp(self) -> QP:
        """Without rows of margins."""
        return self.assembled.qp


class NativePlan:
    """What the core needs of a controller; made anew with each plan.

    Its memory belongs to the controller; threads that share one take turns.
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
    ) -> None:
        tasks = [part.task for part in parts if not part.held]
        self._made_of = robot, tasks, plan, limits, dt, backend, rows
        self._plan, self._parts, self._dt, self._lock = plan, parts, dt, threading.Lock()
        self._limits = _read(limits)
        solver = backend if type(backend) is Daqp and direct_daqp().address else None
        self._solver = solver
        self._memory = NativeMemory(robot, tree, plan, parts, limits, dt, rows, solver)
        self._ends = np.cumsum([len(task.rows) for task in tasks]).tolist()

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
    ) -> NativePlan | None:
        """Return the plan of plain ticks, or None: the core is not there, or does not know all.

        Parameters
        ----------
        backend:
            What solves the QP as it is; DAQP is called by the core itself. None: it does not.
        rows:
            What the torque level adds; None at the velocity level.
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
        for contact, kept in zip(plan.held.contacts, plan.held.kept, strict=True):
            chosen = None if kept is None else kept.tolist()
            parts.append(Part(contact, chosen, held=True, torque=torque))
        if any(part.rows is None for part in parts):
            return None
        return cls(robot, passes.tree, plan, parts, limits, dt, backend, rows)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self).of, self._made_of  # a copy has memory of its own

    def serves(self, limits: Limits | None, dt: float) -> bool:
        """Whether limits and time step are still those that the plan was made for."""
        return dt == self._dt and all(map(operator.is_, self._limits, _read(limits)))

    def problem(
        self, snapshot: Snapshot, ramps: Mapping[str, float] = NO_RAMPS
    ) -> NativeProblem | None:
        """Return the QP at ``snapshot``; None: to be done in Python.

        ``ramps`` are the largest normal forces [N] of contacts that come or go.
        """
        state = snapshot.native_state
        if state is None:
            return None
        memory = self._memory
        with self._lock:
            if not self._write(ramps):
                return None
            memory.state[:] = state.array[: memory.state.size]
            memory.q[:] = snapshot.q
            memory.v[:] = snapshot.v
            start = perf_counter()
            said, out = memory.call(snapshot.moving)
            spent = perf_counter() - start  # setting up the QP takes a third of it
        if said > 0:
            return None
        answer = memory.read(out)
        solution = self._solution(answer, spent) if said == 0 else None
        return self._read(answer, solution)

    def _write(self, ramps: Mapping[str, float]) -> bool:
        """Write what has changed since the last tick; False if that needs another plan."""
        forces = self._memory.forces
        for part in self._parts:
            if part.task._changes != part.changes:
                if forces is not None and part.held:
                    forces.stale = True
                if not part.write(self._dt):
                    return False
        return forces is None or forces.write(ramps)

    def _read(self, answer: Answer, solution: Solution | None) -> NativeProblem:
        labels, rows = self._plan.labels[0], None
        if self._memory.forces is not None:
            rows = self._memory.forces.bounds(answer.C, answer.l, answer.u)
            labels = Labels(labels.equality, rows.labels, labels.variables)
        qp = QP(
            answer.P,
            answer.g,
            answer.A,
            answer.b,
            answer.C,
            answer.l,
            answer.u,
            answer.lower,
            answer.upper,
            labels,
        )
        begin, residuals = 0, []
        errors = answer.errors.copy()  # may be kept longer
        for end in self._ends:
            residuals.append(Residual(errors[begin:end], _NONE, _NONE))
            begin = end
        assembled = Assembled(qp, float(answer.heaviest[0]))
        command = None
        if solution is not None and rows is not None:
            command = np.concatenate((answer.exact, solution.x[6:])), answer.torque.copy()
        matrix, offset = answer.D, answer.offset
        return NativeProblem(assembled, residuals, rows, matrix, offset, solution, command)

    def _solution(self, answer: Answer, spent: float) -> Solution | None:
        """Return what DAQP answered if its residuals are small enough to need no second look."""
        solver = self._solver
        if solver is None:
            return None
        parts = (part.copy() for part in (answer.x, answer.y, answer.z, answer.z_box))
        return accepted(parts, answer.found, solver.eps, spent, solver.name)


def _read(limits: Limits | None) -> tuple[object, ...]:
    """Return what the core was told of the limits, to be compared by identity."""
    if limits is None:
        return (None, None, None, None)
    return limits, limits.speed, limits.acceleration, limits.braking
