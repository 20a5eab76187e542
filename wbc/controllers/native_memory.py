"""The memory of a plan in the native core: what is planned once, and where a tick's QP lies."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from sys import getrefcount
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.constraints.limits import Limits
from wbc.controllers.native_answer import AnswerLayout
from wbc.controllers.native_forces import NativeForces, TorqueRows
from wbc.controllers.native_margin import NativeMargin
from wbc.controllers.native_parts import Block, Part
from wbc.controllers.plan import Plan
from wbc.native import address
from wbc.qp.active_set import ActiveSet
from wbc.qp.problem import QP, Labels
from wbc.qp.proxqp import ProxQP
from wbc.robot import Robot
from wbc.robot.kernel import NativeTree, frame_places
from wbc.robot.names import BASE
from wbc.validate import Array

REDUCED = 7  # of what the core says: enum handed_over of source/core.h


class _Plan(ctypes.Structure):
    """``wbc_plan`` of wbc/native/source/core.h."""

    _fields_ = [
        *(
            (name, ctypes.c_void_p)
            for name in ("tree", "block", "index", "number", "frame_joint", "frame_placement")
            + ("start", "damping", "limit", "force", "corner", "passive", "with_bound")
            + ("torque_bound", "cone", "force_bound", "joint_damping", "state", "out", "scratch")
            + ("order", "margin")
        ),
        *((name, ctypes.c_int64) for name in ("blocks", "frames", "costs", "held", "limited")),
        *((name, ctypes.c_int64) for name in ("torque", "forces", "bearing", "passives")),
        *((name, ctypes.c_int64) for name in ("bounded", "cones", "outside", "always", "most")),
        *((name, ctypes.c_double) for name in ("dt", "mass", "unit", "eps")),
    ]


class NativeMemory:
    """Arrays and structures that the core reads, and what it is called with.

    Parameters
    ----------
    rows:
        What the torque level adds; None at the velocity level.
    margin:
        Between the robot's bodies; None: no rows of it.
    solver:
        Of the QP: the core itself, or ProxQP, which gets it reduced. None: no one's.

    Attributes
    ----------
    answer:
        Where what the core writes lies in ``out``.
    arrays:
        What it reads and works in, by the names of ``wbc_plan`` in source/core.h.
    tree, blocks:
        The structs that it reads besides, but for the forces'.
    """

    def __init__(
        self,
        robot: Robot,
        tree: NativeTree,
        plan: Plan,
        parts: Sequence[Part],
        limits: Limits | None,
        dt: float,
        rows: TorqueRows | None,
        margin: NativeMargin | None,
        solver: ActiveSet | ProxQP | None,
    ) -> None:
        self.tree, self.margin = tree, margin
        frames, index, blocks = self._plan_blocks(parts)
        joint, placement = frame_places(robot.model, [robot.frame_id(name) for name in frames])
        self.forces = None
        if rows is not None:
            contacts = (part.task for part in parts for _ in part.rows or ())
            numbers = {task: number for number, task in enumerate(contacts)}
            self.forces = NativeForces(rows, numbers, robot.damping)
        starts = np.array(robot.limits.starts, dtype=np.int64)
        starts[list(robot.limits.unbounded)] = -starts[list(robot.limits.unbounded)] - 1
        damping = np.array(plan.decision.damping, dtype=float)
        self._slow = None if rows is None else rows.deceleration
        limit = _limit_array(limits, self._slow, robot.nv - 6)
        indices = np.array(index or [0], dtype=np.int64)
        self._size(plan, sum(block.rows for block in blocks if block.held))
        costs = sum(block.rows for block in blocks if not block.held)
        largest = max((block.rows for block in blocks), default=0)
        sizes = np.empty(2, dtype=np.int64)
        tree.core.wbc_sizes(self.n, self.k, self.m, address(sizes))
        solving, integers = sizes.tolist()
        looking = 0 if margin is None else self._margin_scratch_size(margin)
        scratch = np.zeros(max(self._scratch_size(len(frames), largest), solving + looking))
        integers += self.k + (0 if margin is None else margin.pairs)
        order = np.zeros(integers, dtype=np.int64)
        pairs, torque = 0 if margin is None else margin.rows, self.forces is not None
        self.answer = AnswerLayout((self.n, self.k, self.m), tree.nv, costs, torque, pairs)
        self.blocks = (Block * len(blocks))(*blocks)
        self.state = np.zeros(tree.frames)
        self.arrays: dict[str, NDArray[Any]] = {  # the struct points at them
            "index": indices,
            "number": self.number,
            "frame_joint": joint,
            "frame_placement": placement,
            "start": starts,
            "damping": damping,
            "limit": limit,
            "state": self.state,
            "scratch": scratch,
            "order": order,
        }
        counts = {"blocks": len(blocks), "frames": len(frames), "costs": costs, "held": self.held}
        self.struct = _Plan(**counts, limited=limits is not None, dt=dt, mass=robot.mass, unit=1.0)
        self._point(solver)
        function = tree.core.wbc_problem if solver is None else tree.core.wbc_tick
        self._call: Any = function
        self._answer: Any = tree.core.wbc_answer
        self._plan_address = ctypes.addressof(self.struct)
        self._state_address = address(self.state)
        self._asked = b""  # q and v
        self._iterations = self.answer.found.stop - 1
        self.out = np.zeros(self.answer.size)
        self.struct.out = address(self.out)
        self._unshared = getrefcount(self.out)  # of a call's own references Pythons count 1 or 2
        self._reduced: dict[int, QP] = {}  # by its number of rows

    def _point(self, solver: ActiveSet | ProxQP | None) -> None:
        """Let the struct point at all that it needs, of both levels."""
        struct = self.struct
        struct.tree, struct.block = self.tree.address, ctypes.addressof(self.blocks)
        if self.forces is not None:
            self._add_level(self.forces)
        if self.margin is not None:
            struct.margin = self.margin.address
        for name, array in self.arrays.items():
            setattr(struct, name, address(array))
        if solver is not None:
            own = solver if isinstance(solver, ActiveSet) else solver.active_set
            struct.eps, struct.most, struct.outside = own.eps, own.max_iterations, own is not solver
            struct.always = isinstance(solver, ProxQP) and solver.always

    def call(self, measured: bytes, state: Array | None) -> tuple[int, Array]:
        """Run the core; return what it said and what it wrote.

        ``measured`` is q, and v behind it; ``state`` what the core found there before; None: it
        looks now.
        """
        known = None
        if state is not None:
            self.state[:] = state[: self.state.size]
            known = self._state_address
        if getrefcount(self.out) > self._unshared:  # a tick is kept, or a view of its QP
            self.out = np.empty(self.answer.size)
            self.struct.out = address(self.out)
        out = self.out
        out[self._iterations] = 0
        self._asked = measured
        self.said = said = self._call(self._plan_address, known, measured, None)
        return said, out

    def write_limits(self, limits: Limits) -> None:
        """Take over speeds and accelerations that were assigned."""
        limit = self.arrays["limit"]
        limit[:] = _limit_array(limits, self._slow, limits.speed.size)

    @property
    def qp(self) -> QP:
        """What the core left to be solved, a QP without equalities: views on its memory."""
        rows = int(self.out[self.answer.found.start])
        found = self._reduced.get(rows)
        if found is None:
            found = self._reduced[rows] = self._reduced_qp(rows)
        return found

    def _reduced_qp(self, rows: int) -> QP:
        begin = np.zeros(6, dtype=np.int64)
        self.tree.core.wbc_reduced(self._plan_address, address(begin))
        left = int(begin[5])
        sizes = left * left, left, left + rows, left + rows, rows * left
        memory = self.arrays["scratch"]
        P, g, low, up, C = (memory[b : b + k] for b, k in zip(begin.tolist(), sizes, strict=False))
        ends = low[left:], up[left:], low[:left], up[:left]
        none, labels = np.zeros(0), Labels.numbered(left, 0, rows)
        shaped = P.reshape(left, left), g, none.reshape(0, left), none, C.reshape(rows, left)
        return QP(*shaped, *ends, labels)

    @property
    def iterations(self) -> int:
        """Of the last answer."""
        return int(self.out[self._iterations])

    def accept(self, x: bytes, z: bytes, scale: float, iterations: int) -> bool:
        """Whether an answer of the reduced QP makes one of the whole: see :class:`Reduced`."""
        self.said = self._answer(self._plan_address, self._asked, None, x, z, scale, iterations)
        return bool(self.said >= 0)

    def solve(self) -> bool:
        """Whether the core's active-set method does."""
        self.said = self._answer(self._plan_address, self._asked, None, None, None, 1.0, 0)
        return bool(self.said >= 0)

    def _plan_blocks(self, parts: Sequence[Part]) -> tuple[list[str], list[int], list[Block]]:
        """Return frames, entries and blocks; numbers get their places."""
        frames, index, blocks = [BASE], list[int](), list[Block]()
        begins: list[tuple[Part, int]] = []
        size, counts = 0, [0, 0]  # rows of costs, of contacts
        for part in parts:
            for rows in part.rows or ():
                kept = part.chosen(rows)
                if rows.frame is not None and rows.frame not in frames:
                    frames.append(rows.frame)
                frame = -1 if rows.frame is None else frames.index(rows.frame)
                first = counts[part.held]
                blocks.append(
                    Block(rows.kind, part.held, len(kept), first, frame, len(index), size)
                )
                index += [rows.entries[i] for i in kept]
                begins.append((part, size))
                size += part.size(rows)
                counts[part.held] += len(kept)
        self.number = np.zeros(size)
        for part, begin in begins:
            part.place(self.number[begin:])
        return frames, index, blocks

    def _size(self, plan: Plan, held: int) -> None:
        """Set the sizes of the QP: n unknowns, k equalities, m inequality rows."""
        forces = self.forces
        self.held, self.n, self.k = held, plan.decision.size, held
        self.m = 0 if self.margin is None else self.margin.rows
        if forces is not None:
            self.k += forces.passive.size
            self.m += forces.bounded.size + forces.cones

    def _scratch_size(self, frames: int, rows: int) -> int:
        """Return how many numbers setting up the QP needs."""
        tree = self.tree
        work = max(rows * (self.n + 4) + tree.nv * (tree.nv + 10), 13 * tree.joints + 17 * tree.nv)
        if self.margin is not None:
            rows = self.margin.rows * tree.nv
            work = max(work, rows + self._margin_scratch_size(self.margin))
        motion = tree.motion_size if self.forces is not None else 0
        return frames * (tree.frame_size + 6) + motion + work

    def _margin_scratch_size(self, margin: NativeMargin) -> int:
        """Return how many numbers looking where an answer leads needs."""
        there = 3 * self.tree.nv + 6 * self.tree.joints + 7 * margin.rows
        return there + 10 * (margin.bodies + margin.pairs)

    def _add_level(self, forces: NativeForces) -> None:
        """Add what the torque level needs to the arrays and to the struct."""
        self.arrays |= forces.arrays
        struct, layout = self.struct, forces.rows.forces
        struct.force, struct.bearing = ctypes.addressof(forces.structs), forces.count
        struct.torque, struct.forces, struct.unit = 1, layout.size, layout.unit
        struct.passives, struct.bounded = forces.passive.size, forces.bounded.size
        struct.cones = forces.cones


def _limit_array(limits: Limits | None, slow: Array | None, n: int) -> Array:
    """Return bounds, speeds, accelerations, decelerations (5 n) of joints, the base's (12)."""
    if limits is None:
        return np.zeros(5 * n + 12)
    slow = limits.acceleration if slow is None else slow
    joints = (limits.lower, limits.upper, limits.speed, limits.acceleration, slow)
    return np.concatenate((*joints, -limits.base_twist, limits.base_twist))
