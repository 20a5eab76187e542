"""The memory of a plan in the native core: what is planned once, and where a tick's QP lies."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints.limits import Limits
from wbc.controllers.native_forces import NativeForces, TorqueRows
from wbc.controllers.native_margin import NativeMargin
from wbc.controllers.native_parts import Block, Part
from wbc.controllers.plan import Plan
from wbc.native import address
from wbc.qp.daqp import Daqp
from wbc.qp.daqp_direct import direct_daqp
from wbc.qp.native_daqp import scratch_sizes
from wbc.robot import Robot
from wbc.robot.kernel import NativeTree, frame_places
from wbc.robot.names import BASE
from wbc.validate import Array


class _Plan(ctypes.Structure):
    """``wbc_plan`` of wbc/native/source/core.h."""

    _fields_ = [
        *(
            (name, ctypes.c_void_p)
            for name in ("tree", "block", "index", "number", "frame_joint", "frame_placement")
            + ("start", "damping", "limit", "force", "corner", "passive", "with_bound")
            + ("torque_bound", "cone", "force_bound", "joint_damping", "state", "out", "scratch")
            + ("order", "margin", "quadprog", "settings")
        ),
        *((name, ctypes.c_int64) for name in ("blocks", "frames", "costs", "held", "limited")),
        *((name, ctypes.c_int64) for name in ("torque", "forces", "bearing", "passives")),
        *((name, ctypes.c_int64) for name in ("bounded", "cones")),
        *((name, ctypes.c_double) for name in ("dt", "mass", "unit", "eps")),
    ]


class Answer(NamedTuple):
    """What the core wrote: fresh memory, views on one block.

    Attributes
    ----------
    D, offset:
        (nv, n), (nv,): base forces and torques by the unknowns; empty at the velocity level.
    errors:
        Of all tasks, one behind the other.
    heaviest:
        (1,) the largest square of a weighted row.
    x, y, z, z_box, found:
        DAQP's answer, and its residuals and iterations (4,).
    exact, torque:
        v+ (nv,) that meets the base's dynamics to rounding, and torques (nv - 6,) at that.
    clearance, chosen:
        Of the margin's rows, the last of C [m], and the numbers of their pairs.
    """

    P: Array
    A: Array
    C: Array
    D: Array
    offset: Array
    g: Array
    lower: Array
    upper: Array
    b: Array
    l: Array  # noqa: E741
    u: Array
    errors: Array
    heaviest: Array
    x: Array
    y: Array
    z: Array
    z_box: Array
    found: Array
    exact: Array
    torque: Array
    clearance: Array
    chosen: Array


class NativeMemory:
    """Arrays and structures that the core reads, and what it is called with.

    Parameters
    ----------
    rows:
        What the torque level adds; None at the velocity level.
    margin:
        Between the robot's bodies; None: no rows of it.
    solver:
        DAQP's settings, if the core is to solve the QP too.

    Attributes
    ----------
    velocity, contact_forces, torque:
        Where these are in what the core writes: see :class:`Answer`.
    size:
        How many numbers it writes.
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
        solver: Daqp | None,
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
        slow = None if rows is None else rows.deceleration
        limit = _limit_array(limits, slow, robot.nv - 6)
        indices = np.array(index or [0], dtype=np.int64)
        self._size(plan, sum(block.rows for block in blocks if block.held))
        costs = sum(block.rows for block in blocks if not block.held)
        largest = max((block.rows for block in blocks), default=0)
        solving, integers = scratch_sizes(self.n, self.k, self.m)
        scratch = np.zeros(max(self._scratch_size(len(frames), largest), solving))
        order = np.zeros(max(integers, 0 if margin is None else margin.pairs), dtype=np.int64)
        self._cut(costs)
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
        self._plan_address = ctypes.addressof(self.struct)
        self._state_address = address(self.state)

    def _point(self, solver: Daqp | None) -> None:
        """Let the struct point at all that it needs, of both levels."""
        struct = self.struct
        struct.tree, struct.block = self.tree.address, ctypes.addressof(self.blocks)
        if self.forces is not None:
            self._add_level(self.forces)
        if self.margin is not None:
            struct.margin = self.margin.address
        for name, array in self.arrays.items():
            setattr(struct, name, address(array))
        self._settings = None
        if solver is not None:
            self._settings = direct_daqp().settings(solver.eps, solver.max_iterations)
            struct.eps = solver.eps
            struct.quadprog = direct_daqp().address
            struct.settings = ctypes.addressof(self._settings)

    def call(self, q: Array, v: Array, moving: bool, state: Array | None) -> tuple[int, Array]:
        """Run the core; return what it said and what it wrote.

        ``state`` is what it found at (q, v) before; None: it looks now.
        """
        known = None
        if state is not None:
            self.state[:] = state[: self.state.size]
            known = self._state_address
        out = np.empty(self.size)
        self.struct.out = address(out)
        said = self._call(self._plan_address, known, q.tobytes(), v.tobytes(), moving)
        return said, out

    def read(self, out: Array) -> Answer:
        """Return views on what the core wrote."""
        n = self.n
        P, A, C, D, *vectors = [out[place] for place in self._places]
        matrices = P.reshape(n, n), A.reshape(-1, n), C.reshape(-1, n), D.reshape(-1, n)
        return Answer(*matrices, *vectors)

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

    def _cut(self, costs: int) -> None:
        """Set where the fields of :class:`Answer` lie: as in lay_out of source/problem.c."""
        n, k, m, nv = self.n, self.k, self.m, self.tree.nv
        D = nv if self.forces is not None else 0
        sizes = [n * n, k * n, m * n, D * n, D, n, n, n, k, m, m, costs, 1, n, k, m, n, 4]
        sizes += [nv, nv - 6] if D else [0, 0]
        sizes += [0, 0] if self.margin is None else 2 * [self.margin.rows]
        ends = np.cumsum(sizes).tolist()
        self._places = places = [slice(b, e) for b, e in zip([0, *ends[:-1]], ends, strict=True)]
        self.size = ends[-1]
        x, exact, self.torque = (places[k] for k in (13, 18, 19))
        self.velocity = exact if D else slice(x.start, x.start + nv)
        self.contact_forces = slice(x.start + nv, x.stop)

    def _scratch_size(self, frames: int, rows: int) -> int:
        """Return how many numbers setting up the QP needs."""
        tree = self.tree
        work = max(rows * (tree.nv + 4) + tree.nv * (tree.nv + 12), 13 * tree.joints + 6 * tree.nv)
        if self.margin is not None:
            pairs = 10 * (self.margin.bodies + self.margin.pairs)
            there = 3 * tree.nv + 6 * tree.joints
            work = max(work, self.margin.rows * (tree.nv + 7) + there + pairs)
        motion = tree.motion_size if self.forces is not None else 0
        return frames * (tree.frame_size + 6) + motion + work

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
