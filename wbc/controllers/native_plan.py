"""Plain ticks of the velocity level in the native core: from a snapshot to the QP in one call.

Plain means one level, contacts met exactly, free braking, no singular threshold, and tasks that
describe their rows (:meth:`wbc.tasks.task.Task.native`). The QP is that of the Python tick to
rounding, and all behind it is shared. Whatever else comes, such as a joint outside its limits, is
handed back: the same snapshot then goes through the Python tick.
"""

from __future__ import annotations

import ctypes
import math
import operator
import threading
from collections.abc import Sequence
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints.limits import Limits
from wbc.controllers.plan import Assembled, Plan
from wbc.laws import Residual, VelocityLaw
from wbc.native.rows import NativeRows
from wbc.qp.backend import Backend
from wbc.qp.daqp import Daqp
from wbc.qp.daqp_direct import direct_daqp
from wbc.qp.problem import QP
from wbc.qp.solution import KktResiduals, Solution, Status
from wbc.robot import Robot, Snapshot
from wbc.robot.kernel import frame_places
from wbc.robot.names import BASE
from wbc.tasks.task import Task
from wbc.validate import Array, read_only

_HEADER = 3  # rate, half the gain for curvature damping, Levenberg-Marquardt damping
_NONE: Array = read_only(np.zeros(0))


class _Block(ctypes.Structure):
    """``wbc_block`` of wbc/native/source/core.h."""

    _fields_ = [
        (name, ctypes.c_int64)
        for name in ("kind", "held", "rows", "first", "frame", "index", "number")
    ]


class _Plan(ctypes.Structure):
    """``wbc_plan`` of wbc/native/source/core.h."""

    _fields_ = [
        *(
            (name, ctypes.c_void_p)
            for name in ("tree", "block", "index", "number", "frame_joint", "frame_placement")
            + ("start", "damping", "limit", "out", "scratch", "order", "quadprog", "settings")
        ),
        *((name, ctypes.c_int64) for name in ("blocks", "frames", "costs", "held", "limited")),
        ("dt", ctypes.c_double),
    ]


class _Part:
    """One task or contact: where its numbers go, and which of them are there already.

    Parameters
    ----------
    kept:
        The rows of a contact that the QP gets; None for all.
    """

    def __init__(self, task: Task, kept: Sequence[int] | None, held: bool) -> None:
        self.task = task
        self.held = held
        self.kept = None if kept is None else list(kept)
        self.rows = described(task)
        self.changes = -1  # of the task, when its numbers were written
        self._places: list[tuple[Array, ...]] = []
        self._law: VelocityLaw | None = None

    def chosen(self, rows: NativeRows) -> list[int]:
        """Return the rows of a block that are kept."""
        return list(range(len(rows.entries))) if self.kept is None else self.kept

    def size(self, rows: NativeRows) -> int:
        """Return how many numbers a block has."""
        return _HEADER + 2 * len(self.chosen(rows)) + sum(map(np.size, rows.numbers))

    def place(self, memory: Array) -> None:
        """Remember where the numbers of the next block go."""
        rows = (self.rows or ())[len(self._places)]
        k = len(self.chosen(rows))
        sizes = (_HEADER, k, k, *map(np.size, rows.numbers))
        ends = np.cumsum(sizes).tolist()
        self._places.append(
            tuple(memory[end - size : end] for end, size in zip(ends, sizes, strict=True))
        )

    def write(self, dt: float) -> bool:
        """Write the numbers of a task that was changed; False if it is another one now."""
        task, planned = self.task, self.rows
        changes, found = task._changes, described(task)
        if found is None or planned is None or len(found) != len(planned):
            return False
        offset = 0
        for now, before, place in zip(found, planned, self._places, strict=True):
            header, weight, bias, *numbers = place
            if (now[:3], len(now.numbers)) != (before[:3], len(numbers)):
                return False
            if task.law is not self._law:
                gain = task.law.fraction(dt)
                half = 0.5 * gain if task.law.curvature_damping and now.curved else 0.0
                header[:] = gain / dt, half, task.law.lm_damping
            k = len(now.entries)
            if self.kept is None:
                weight[:], bias[:] = task.weight[offset : offset + k], now.bias
            else:
                weight[:], bias[:] = task.weight[self.kept], now.bias[self.kept]
            for to, values in zip(numbers, now.numbers, strict=True):
                if values.size != to.size:
                    return False
                to[:] = values
            offset += k
        self.changes, self._law = changes, task.law
        return True


class NativeProblem(NamedTuple):
    """A QP, what diagnostics want to know of the tasks, and maybe the QP's checked solution."""

    assembled: Assembled
    residuals: list[Residual]
    solution: Solution | None

    @property
    def qp(self) -> QP:
        """Without inequality rows."""
        return self.assembled.qp


class NativePlan:
    """What the core needs of a controller; made anew with each plan.

    Its memory belongs to the controller; threads that share one take turns.
    """

    def __init__(
        self,
        robot: Robot,
        plan: Plan,
        parts: Sequence[_Part],
        limits: Limits | None,
        dt: float,
        backend: Backend | None,
    ) -> None:
        passes = robot.native
        assert passes is not None
        self._made_of = robot, [p.task for p in parts if not p.held], plan, limits, dt, backend
        self._plan, self._parts, self._dt, self._lock = plan, parts, dt, threading.Lock()
        self._limits = _read(limits)
        self._tree = tree = passes.tree
        nv, n = robot.nv, robot.nv - 6
        frames = [BASE]
        index: list[int] = []
        blocks: list[tuple[int, ...]] = []
        begins: list[tuple[_Part, int]] = []
        size, costs, held = 0, 0, 0
        for part in parts:
            for rows in part.rows or ():
                kept = part.chosen(rows)
                k, first = len(kept), held if part.held else costs
                frame = -1 if rows.frame is None else _place(frames, rows.frame)
                blocks.append((rows.kind, part.held, k, first, frame, len(index), size))
                index += [rows.entries[i] for i in kept]
                begins.append((part, size))
                size += part.size(rows)
                held, costs = (held + k, costs) if part.held else (held, costs + k)
        self._ends = np.cumsum([len(part.task.rows) for part in parts if not part.held]).tolist()
        starts = np.array(robot.limits.starts, dtype=np.int64)
        starts[list(robot.limits.unbounded)] = -starts[list(robot.limits.unbounded)] - 1
        joint, placement = frame_places(robot.model, [robot.frame_id(name) for name in frames])
        limit = _limit_array(limits, n)
        self._number = np.zeros(size)
        for part, begin in begins:
            part.place(self._number[begin:])
        sizes = (nv * nv, held * nv, nv, nv, nv, held, costs, 1, nv, held, nv, 4)
        self._cuts = [0, *np.cumsum(sizes).tolist()]
        self._out = np.zeros(self._cuts[-1])
        most, solving = max(costs, 6), 2 * held * nv + nv * nv + 6 * nv + held
        scratch = np.zeros(max(len(frames) * tree.frame_size + most * (nv + 2), 2 * solving))
        order = np.zeros(2 * nv, dtype=np.int64)
        self._daqp = backend if type(backend) is Daqp and direct_daqp().address else None
        settings = None
        if self._daqp is not None:
            settings = direct_daqp().settings(self._daqp.eps, self._daqp.max_iterations)
        self._state, self._q, self._v = np.zeros(tree.frames), np.zeros(robot.nq), np.zeros(nv)
        self._struct_blocks = (_Block * len(blocks))(*(_Block(*block) for block in blocks))
        indices = np.array(index or [0], dtype=np.int64)
        arrays: tuple[NDArray[Any], ...]
        damping = np.array(plan.decision.damping, dtype=float)
        arrays = (indices, self._number, joint, placement, starts, damping, limit)
        self._kept = arrays = (*arrays, self._out, scratch, order)  # the struct points at them
        self._settings = settings
        solver = (0, 0)
        if settings is not None:
            solver = (direct_daqp().address, ctypes.addressof(settings))
        addresses = (*(array.ctypes.data for array in arrays), *solver)
        counts = (len(blocks), len(frames), costs, held, limits is not None)
        where = ctypes.addressof(self._struct_blocks)
        self._struct = _Plan(tree.address, where, *addresses, *counts, dt)
        state, q, v = (array.ctypes.data for array in (self._state, self._q, self._v))
        self._call = tree.core.wbc_tick if settings is not None else tree.core.wbc_problem
        self._arguments = ctypes.addressof(self._struct), state, q, v
        self._sizes = held, nv

    @classmethod
    def of(
        cls,
        robot: Robot,
        tasks: Sequence[Task],
        plan: Plan,
        limits: Limits | None,
        dt: float,
        backend: Backend | None = None,
    ) -> NativePlan | None:
        """Return the plan of plain ticks, or None: the core is not there, or does not know all.

        Parameters
        ----------
        backend:
            What solves the QP as it is; DAQP is called by the core itself. None: it does not.
        """
        passes = robot.native
        if passes is None or len(plan.levels) > 1 or plan.soft or plan.decision.size != robot.nv:
            return None
        if limits is not None and limits.braking != "free":
            return None
        parts = [_Part(task, None, held=False) for task in tasks]
        for contact, kept in zip(plan.held.contacts, plan.held.kept, strict=True):
            parts.append(_Part(contact, None if kept is None else kept.tolist(), held=True))
        if any(part.rows is None for part in parts):
            return None
        return cls(robot, plan, parts, limits, dt, backend)

    def __reduce__(self) -> tuple[object, ...]:
        return type(self).of, self._made_of  # a copy has memory of its own

    def serves(self, limits: Limits | None, dt: float) -> bool:
        """Whether limits and time step are still those that the plan was made for."""
        return dt == self._dt and all(map(operator.is_, self._limits, _read(limits)))

    def problem(self, snapshot: Snapshot) -> NativeProblem | None:
        """Return the QP at ``snapshot``; None: to be done in Python."""
        state = snapshot.native_state
        if state is None:
            return None
        with self._lock:
            for part in self._parts:
                if part.task._changes != part.changes and not part.write(self._dt):
                    return None
            self._state[:] = state.array[: self._state.size]
            self._q[:] = snapshot.q
            self._v[:] = snapshot.v
            start = perf_counter()
            said = self._call(*self._arguments, snapshot.moving)
            spent = perf_counter() - start  # setting up the QP takes a third of it
            if said > 0:
                return None
            every = self._out.copy()
        cuts = self._cuts
        out, errors = every[: cuts[6]], every[cuts[6] : cuts[7]].copy()  # errors may be kept longer
        P, A, g = out[: cuts[1]], out[cuts[1] : cuts[2]], out[cuts[2] : cuts[3]]
        lower, upper, b = out[cuts[3] : cuts[4]], out[cuts[4] : cuts[5]], out[cuts[5] :]
        held, nv = self._sizes
        none, labels = self._plan.decision.no_rows, self._plan.labels[0]
        qp = QP(
            P.reshape(nv, nv),
            g,
            A.reshape(held, nv),
            b,
            none.matrix,
            none.lower,
            none.upper,
            lower,
            upper,
            labels,
        )
        begin, residuals = 0, []
        for end in self._ends:
            residuals.append(Residual(errors[begin:end], _NONE, _NONE))
            begin = end
        solved = said == 0 and self._daqp is not None
        assembled = Assembled(qp, float(every[cuts[7]]))
        return NativeProblem(assembled, residuals, self._solution(every, spent) if solved else None)

    def _solution(self, out: Array, spent: float) -> Solution | None:
        """Return what DAQP answered if its residuals are small enough to need no second look."""
        assert self._daqp is not None
        eps, cuts = self._daqp.eps, self._cuts
        *residuals, iterations = out[cuts[11] :].tolist()
        if not max(residuals) <= eps or math.isnan(sum(residuals)):
            return None
        x, y, z_box = (out[cuts[k] : cuts[k + 1]].copy() for k in (8, 9, 10))
        return Solution(
            x, y, _NONE, z_box, Status.SOLVED, KktResiduals(*residuals), int(iterations), spent,
            self._daqp.name,
        )  # fmt: skip


def described(task: Task) -> Sequence[NativeRows] | None:
    """Return what a task says of its rows, if its law is one that the core knows."""
    law, kind = task.law, type(task)
    if "native" not in vars(kind) or "residual" in vars(task) or type(law) is not VelocityLaw:
        return None
    if law.singular_threshold > 0.0:
        return None
    rows = task.native()
    if rows is not None and len(rows) > 1 and law.lm_damping > 0.0:
        return None  # by the error of the whole task, which is in several blocks
    return rows


def _read(limits: Limits | None) -> tuple[object, ...]:
    """Return what the core was told of the limits, to be compared by identity."""
    if limits is None:
        return (None, None, None, None)
    return limits, limits.speed, limits.acceleration, limits.braking


def _place(frames: list[str], frame: str) -> int:
    if frame not in frames:
        frames.append(frame)
    return frames.index(frame)


def _limit_array(limits: Limits | None, n: int) -> Array:
    """Return bounds, speeds and accelerations (4 n) of the joints, then the base's (12)."""
    if limits is None:
        return np.zeros(4 * n + 12)
    joints = (limits.lower, limits.upper, limits.speed, limits.acceleration)
    return np.concatenate((*joints, -limits.base_twist, limits.base_twist))
