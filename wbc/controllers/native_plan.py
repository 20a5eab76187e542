"""Plain ticks of the velocity level in the native core: from a snapshot to the QP in one call.

Plain means one level, contacts met exactly, free braking, no singular threshold, and tasks that
describe their rows (:meth:`wbc.tasks.task.Task.native`). The QP is that of the Python tick to
rounding, and all behind it is shared. Whatever else comes, such as a joint outside its limits, is
handed back: the same snapshot then goes through the Python tick.
"""

from __future__ import annotations

import ctypes
import operator
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints.limits import Limits
from wbc.controllers.plan import Plan
from wbc.laws import Residual, VelocityLaw
from wbc.native.rows import NativeRows
from wbc.qp.problem import QP
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
            + ("start", "damping", "limit", "out", "scratch")
        ),
        *((name, ctypes.c_int64) for name in ("blocks", "frames", "costs", "held", "limited")),
        ("dt", ctypes.c_double),
    ]


class _Part:
    """One task or contact: where its numbers go, and which of them are there already."""

    def __init__(self, task: Task, kept: Sequence[int] | None, held: bool) -> None:
        self.task = task
        self.held = held
        self.kept = None if kept is None else list(kept)
        self.rows = described(task)
        self.changes = -1
        self.begins: list[int] = []

    @property
    def shape(self) -> list[tuple[object, ...]]:
        """What must stay as it was planned."""
        return [_shape(rows) for rows in self.rows or ()]

    def blocks(self) -> list[tuple[NativeRows, list[int]]]:
        """Return each block with the rows of it that are kept."""
        found = []
        for rows in self.rows or ():
            kept = list(range(len(rows.entries))) if self.kept is None else self.kept
            found.append((rows, kept))
        return found


class NativeProblem(NamedTuple):
    """A QP, and what diagnostics want to know of the tasks."""

    qp: QP
    residuals: list[Residual]


class NativePlan:
    """What the core needs of a controller; made anew with each plan.

    Its memory belongs to the controller: like the controller, it serves one thread at a time.
    """

    def __init__(
        self, robot: Robot, plan: Plan, parts: Sequence[_Part], limits: Limits | None, dt: float
    ) -> None:
        passes = robot.native
        assert passes is not None
        self._plan, self._parts, self._dt = plan, parts, dt
        self._limits = _read(limits)
        self._tree = tree = passes.tree
        nv, n = robot.nv, robot.nv - 6
        frames = [BASE]
        index: list[int] = []
        blocks: list[tuple[int, ...]] = []
        size, costs, held = 0, 0, 0
        for part in parts:
            for rows, kept in part.blocks():
                k, first = len(kept), held if part.held else costs
                frame = -1 if rows.frame is None else _place(frames, rows.frame)
                blocks.append((rows.kind, part.held, k, first, frame, len(index), size))
                index += [rows.entries[i] for i in kept]
                part.begins.append(size)
                size += _HEADER + 2 * k + sum(map(np.size, rows.numbers))
                held, costs = (held + k, costs) if part.held else (held, costs + k)
        self._ends = np.cumsum([len(part.task.rows) for part in parts if not part.held]).tolist()
        starts = np.array(robot.limits.starts, dtype=np.int64)
        starts[list(robot.limits.unbounded)] = -starts[list(robot.limits.unbounded)] - 1
        joint, placement = frame_places(robot.model, [robot.frame_id(name) for name in frames])
        limit = _limit_array(limits, n)
        self._number = np.zeros(size)
        sizes = (nv * nv, held * nv, nv, nv, nv, held, costs)
        self._cuts = [0, *np.cumsum(sizes).tolist()]
        self._out = np.zeros(self._cuts[-1])
        scratch = np.zeros(len(frames) * tree.frame_size + max(costs, 6) * (nv + 2))
        self._state, self._q, self._v = np.zeros(tree.frames), np.zeros(robot.nq), np.zeros(nv)
        self._struct_blocks = (_Block * len(blocks))(*(_Block(*block) for block in blocks))
        indices = np.array(index or [0], dtype=np.int64)
        arrays: tuple[NDArray[Any], ...]
        damping = np.array(plan.decision.damping, dtype=float)
        arrays = (indices, self._number, joint, placement, starts, damping, limit)
        self._kept = arrays = (*arrays, self._out, scratch)  # the struct points at them
        addresses = [array.ctypes.data for array in arrays]
        counts = (len(blocks), len(frames), costs, held, limits is not None)
        where = ctypes.addressof(self._struct_blocks)
        self._struct = _Plan(tree.address, where, *addresses, *counts, dt)
        state, q, v = (array.ctypes.data for array in (self._state, self._q, self._v))
        self._call = tree.core.wbc_problem
        self._arguments = ctypes.addressof(self._struct), state, q, v
        self._sizes = held, nv

    @classmethod
    def of(
        cls, robot: Robot, tasks: Sequence[Task], plan: Plan, limits: Limits | None, dt: float
    ) -> NativePlan | None:
        """Return the plan of plain ticks, or None: the core is not there, or does not know all."""
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
        return cls(robot, plan, parts, limits, dt)

    def serves(self, limits: Limits | None, dt: float) -> bool:
        """Whether limits and time step are still those that the plan was made for."""
        return dt == self._dt and all(map(operator.is_, self._limits, _read(limits)))

    def problem(self, snapshot: Snapshot) -> NativeProblem | None:
        """Return the QP at ``snapshot``; None: to be done in Python."""
        state = snapshot.native_state
        if state is None:
            return None
        for part in self._parts:
            if part.task._changes != part.changes and not self._refresh(part):
                return None
        self._state[:] = state.array[: self._state.size]
        self._q[:] = snapshot.q
        self._v[:] = snapshot.v
        if self._call(*self._arguments, snapshot.moving):
            return None
        cuts = self._cuts
        out = self._out[: cuts[6]].copy()
        errors = self._out[cuts[6] :].copy()  # they may be kept longer than the QP
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
        return NativeProblem(qp, residuals)

    def _refresh(self, part: _Part) -> bool:
        """Write the numbers of a task that was changed; False if it is another one now."""
        changes = part.task._changes
        rows, law = described(part.task), part.task.law
        if rows is None or [_shape(one) for one in rows] != part.shape:
            return False
        part.rows = rows
        gain = law.fraction(self._dt)
        offset = 0
        for (block, kept), begin in zip(part.blocks(), part.begins, strict=True):
            half = 0.5 * gain if law.curvature_damping and block.curved else 0.0
            weight = part.task.weight[offset : offset + len(block.entries)]
            offset += len(block.entries)
            header = (gain / self._dt, half, law.lm_damping)
            new = np.concatenate((header, weight[kept], block.bias[kept], *block.numbers))
            self._number[begin : begin + new.size] = new
        part.changes = changes
        return True


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


def _shape(rows: NativeRows) -> tuple[object, ...]:
    """Return what the plan's places depend on."""
    return rows.kind, rows.frame, rows.entries, tuple(np.size(part) for part in rows.numbers)


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
