"""The memory of a plan in the core: what is planned once, and where a tick's QPs lie."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.constraints.limits import Limits
from wbc.constraints.mechanics import Mechanics
from wbc.constraints.rows import Bounds
from wbc.controllers.blocks import CoreBlocks, Part
from wbc.controllers.core_layout import Layout
from wbc.controllers.force_rows import NativeForces, TorqueRows
from wbc.controllers.margin_rows import NativeMargin
from wbc.controllers.plan import LevelPlan
from wbc.native import doubles, ffi, integers, lib, pointer
from wbc.qp.active_set import ActiveSet
from wbc.qp.problem import QP, Labels
from wbc.qp.proxqp import ProxQP
from wbc.robot import Robot, Snapshot
from wbc.robot.kernel import NativeTree, frame_places, joint_starts
from wbc.validate import Array

# Status values of the core: enum status of source/core.h.
INFEASIBLE, UNSOLVED, DONE, NOT_FINITE = lib.INFEASIBLE, lib.UNSOLVED, lib.DONE, lib.NOT_FINITE
NOT_MEASURED, LEADS_INSIDE, MORE_ROWS = lib.NOT_MEASURED, lib.LEADS_INSIDE, lib.MORE_ROWS
REDUCED = lib.REDUCED
NULL, NOTHING = ffi.NULL, np.empty(0)


class CoreMemory:
    """Arrays and structures that the core reads, and what it is called with.

    ``rows``: what the torque level adds; None at the velocity level.
    ``margin``: between the robot's bodies; None: no rows of it.
    ``solver``: solves the first level: the core itself, or ProxQP on the reduced QP. None: the core
    only sets the QP up.
    ``error_offset``: (held,) added to the errors of loops and gears; :class:`LoopClosing` writes
    it.
    ``keeps_rows``: whether the rows of costs stay readable after the tick.

    ``arrays``: inputs and scratch of the core, by the names of ``wbc_plan`` in source/core.h.
    ``struct``: pointer to the ``wbc_plan``.
    ``tree``, ``blocks``: the other structs that it reads, except those of the forces.
    ``status``: returned by the core's last call.
    """

    def __init__(
        self,
        robot: Robot,
        tree: NativeTree,
        plan: LevelPlan,
        parts: Sequence[Part],
        limits: Limits | None,
        dt: float,
        rows: TorqueRows | None,
        margin: NativeMargin | None,
        solver: ActiveSet | ProxQP | None,
        error_offset: Array,
        keeps_rows: bool,
    ) -> None:
        self.tree, self.margin, self.levels = tree, margin, len(plan.levels)
        self.curved = any(part.second_order for part in parts)
        self.keeps_rows = keeps_rows or self.levels > 1 or self.curved
        self.forces, self._planned = None, CoreBlocks.of(parts)
        if rows is not None:
            contacts = (part.task for part in parts for _ in part.rows or ())
            numbers = {task: number for number, task in enumerate(contacts)}
            self.forces = NativeForces(rows, numbers, robot, dt)
        self._slow = None if rows is None else rows.deceleration
        self.held, self.costs = self._planned.held, self._planned.costs
        self.n, self.k = plan.decision.size, self.held
        self._m = 0 if margin is None else margin.rows
        if self.forces is not None:
            self.k += self.forces.passive.size
            self._m += self.forces.bounded.size + self.forces.cones
        self.state = np.zeros(tree.frames)
        limit = np.zeros(0) if limits is None else limits.numbers(self._slow)
        self.arrays = self._planned_arrays(robot)  # the struct points at them
        self.arrays |= {"damping": plan.decision.damping.copy(), "limit": limit}
        self.arrays["added"] = error_offset
        self.blocks = ffi.new("wbc_block[]", self._planned.blocks)
        settings = {"dt": dt, "mass": robot.mass, "unit": 1.0, "eps": 1e-8, "most": 1000}
        self.struct = ffi.new("wbc_plan *", {**self._planned.counts, **settings})
        self.struct.levels, self.struct.curved = self.levels, self.curved
        self.struct.wide = self.n if self._planned.of_forces else tree.nv
        if limits is not None:
            self.struct.limited, self.struct.recovery = True, limits.recovery
            self.struct.braked = limits.braking == "bounded"
        nonlinear_loops = any(
            isinstance(part.task, Mechanics) and part.task.nonlinear for part in parts
        )
        self.struct.closing = nonlinear_loops and rows is None and solver is not None
        self._preferred, self._outside = np.zeros(0, dtype=np.int64), False
        self._point(solver)
        self._tick: Any = lib.wbc_problem if solver is None else lib.wbc_tick
        self._state_pointer = doubles(self.state)
        self._measured = b""  # q and v
        self._layouts: dict[tuple[int, int], Layout] = {}
        self._reduced: dict[int, QP] = {}  # by its number of rows
        self.status, self.out, self.below = DONE, NOTHING, NOTHING
        self._fit(0)
        self.layout, self.given_rows = self.layout_of(0, 0), 0

    def _planned_arrays(self, robot: Robot) -> dict[str, NDArray[Any]]:
        """Return the arrays of blocks and frames, and the memory for rows of costs."""
        planned, n, nv = self._planned, self.n, self.tree.nv
        joint, placement = frame_places(robot.model, [*map(robot.frame_id, planned.frames)])
        arrays: dict[str, NDArray[Any]] = {
            "index": np.array(planned.entries or [0], dtype=np.int64),
            "number": planned.number,
            "frame_joint": joint,
            "frame_placement": placement,
            "start": joint_starts(robot.limits),
            "given": np.zeros(0),
            "push": np.zeros(0),
            "state": self.state,
        }
        if self.keeps_rows:
            size = self.costs * (n + 2) + self.levels * nv * (1 + nv * self.curved)
            arrays["rows"] = np.zeros(size)
        if planned.moments:
            arrays["moments"] = np.zeros(planned.moments * (n - nv))
        return arrays

    def _point(self, solver: ActiveSet | ProxQP | None) -> None:
        """Set the pointers and settings of the struct."""
        struct = self.struct
        struct.tree, struct.block = self.tree.struct, self.blocks
        if self.forces is not None:
            self._add_level(self.forces)
        if self.margin is not None:
            struct.margin = self.margin.struct
        for name, array in self.arrays.items():
            setattr(struct, name, pointer(array))
        if solver is not None:
            own = solver if isinstance(solver, ActiveSet) else solver.active_set
            struct.eps, struct.most, struct.outside = own.eps, own.max_iterations, own is not solver
            self._outside = own is not solver
            struct.always = isinstance(solver, ProxQP) and solver.always

    # ------------------------------------------------------------------ calls

    def call(self, measured: bytes, state: Array | None, solve: bool = True) -> int:
        """Run the core in new memory, which the tick keeps as its evidence; return the status.

        ``measured``: q, then v.
        ``state``: the kinematic state that the core computed there before; None: it is computed
        now.
        ``solve``: whether the QP is solved too, if the core solves it.
        """
        known, layout, struct = NULL, self.layout, self.struct
        if state is not None:
            self.state[:] = state[: self.state.size]
            known = self._state_pointer
        self.out = NOTHING  # frees the memory of a tick that nobody keeps, for this one
        self.out = out = np.empty(layout.out)
        struct.out = doubles(out)
        if layout.below:
            self.below = np.empty(layout.below)
            struct.below = doubles(self.below)
        self._measured = measured
        function = self._tick if solve else lib.wbc_problem
        self.status = status = function(struct, known, measured, NULL)
        return status

    @property
    def _last_state(self) -> Any:
        """A pointer to q and v of the last call."""
        return doubles(self._measured)

    def accept(self, x: bytes, z: bytes, scale: float, iterations: int) -> bool:
        """Return whether a solution of the reduced QP solves the level: see :class:`Reduced`."""
        self.status = lib.wbc_answer(self.struct, doubles(x), doubles(z), scale, iterations)
        return bool(self.status == DONE)

    def solve(self) -> bool:
        """Solve the reduced QP by the core's active-set method; return whether that worked."""
        self.status = lib.wbc_answer(self.struct, NULL, NULL, 1.0, 0)
        return bool(self.status == DONE)

    def pose_level(self, level: int) -> int:
        """Write the QP of a level below the first."""
        return int(lib.wbc_pose(self.struct, self._last_state, NULL, level))

    def solve_level(self, level: int) -> int:
        """Solve a level's QP in the core; the first level's status may be REDUCED."""
        self.status = int(lib.wbc_solve(self.struct, level))
        return self.status

    def descend(self) -> int:
        """Solve the levels below the first, whose solution is in memory; write the command."""
        self.status = int(lib.wbc_descend(self.struct, self._last_state, NULL))
        return self.status

    def finish(self) -> int:
        """Write the command of the last level that was solved."""
        self.status = int(lib.wbc_finish(self.struct, self._last_state, NULL))
        return self.status

    def gaps(self, snapshot: Snapshot, v: Array) -> Array:
        """Return how far loops and gears are open (held,) where a command leads [m, rad]."""
        gaps, at = np.empty(self.held), (snapshot.native_state.array, snapshot.q, v)
        lib.wbc_gaps(self.struct, *map(doubles, at), doubles(gaps))
        return gaps

    def cost(self, level: int) -> tuple[Array, Array]:
        """Return P (n, n) and g (n,) of one level, or of all (-1), from the rows in memory."""
        P, g = np.empty((self.n, self.n)), np.empty(self.n)
        lib.wbc_cost(self.struct, self._last_state, NULL, level, doubles(P), doubles(g))
        return P, g

    @property
    def preferred_columns(self) -> bytes:
        """Columns that the last tick eliminated: with ProxQP the next tick prefers them."""
        return self._preferred.tobytes() if self._outside else b""

    @preferred_columns.setter
    def preferred_columns(self, columns: bytes) -> None:
        if len(columns) == self._preferred.nbytes:
            self._preferred[:] = np.frombuffer(columns, dtype=np.int64)

    @property
    def qp(self) -> QP:
        """The reduced QP, without equalities: views on the core's memory."""
        rows = int(self.out[self.layout.found][0])
        found = self._reduced.get(rows)
        if found is None:
            found = self._reduced[rows] = self._reduced_qp(rows)
        return found

    def _reduced_qp(self, rows: int) -> QP:
        begin = np.zeros(6, dtype=np.int64)
        lib.wbc_reduced(self.struct, integers(begin))
        left = int(begin[5])
        memory = self.arrays["scratch"]
        sizes = left * left, left, left + rows, left + rows, rows * left
        P, g, low, up, C = (memory[b : b + k] for b, k in zip(begin.tolist(), sizes, strict=False))
        ends = low[left:], up[left:], low[:left], up[:left]
        none, labels = np.zeros(0), Labels((), (), ())  # the level's own QP has names
        shaped = P.reshape(left, left), g, none.reshape(0, left), none, C.reshape(rows, left)
        return QP(*shaped, *ends, labels)

    @property
    def iterations(self) -> int:
        """Iterations of the first level's last solution."""
        return int(self.out[self.layout.found][3])

    # ------------------------------------------------------------------ what is written

    def write_limits(self, limits: Limits) -> None:
        """Write the joint limits again."""
        self.arrays["limit"][:] = limits.numbers(self._slow)
        self.struct.recovery = limits.recovery

    def write_bounds(self, bounds: Bounds | None) -> None:
        """Write inequality rows that were computed in Python, and the cost that recovers them."""
        struct, nv = self.struct, self.tree.nv
        count = 0 if bounds is None else bounds.lower.size
        if count != struct.given_rows:
            self._fit(count)
            self.layout, self.given_rows = self.layout_of(0, count), count
        struct.given_rows, struct.pushes, struct.soft = count, 0, 0
        if bounds is None:
            return
        give = np.zeros(count) if bounds.slack is None else 1.0 / bounds.slack
        struct.soft = bool(give.any())
        rows = bounds.matrix[:, :nv].ravel(), bounds.lower, bounds.upper, give
        self._put("given", np.concatenate(rows))
        if bounds.push is not None:
            push = bounds.push
            struct.pushes = push.target.size
            self._put("push", np.concatenate((push.matrix.ravel(), push.target, push.weight)))

    def _put(self, name: str, array: Array) -> None:
        self.arrays[name] = array
        setattr(self.struct, name, pointer(array))

    def _fit(self, given: int) -> None:
        """Allocate scratch for so many given rows."""
        n, m = self.n, self._m + given
        k = self.k + (self.costs if self.levels > 1 else 0)
        sizes = np.empty(3, dtype=np.int64)
        lib.wbc_sizes(n, k, m, integers(sizes))
        solver_end, order, begin = sizes.tolist()
        solver_end += m
        looking = self.held + 2 * (n + self.k) + m + 5 if self.struct.closing else 0
        if self.margin is not None:
            looking = max(looking, self._margin_scratch_size(self.margin))
        scratch = max(self._scratch_size(), solver_end + max(looking, n))
        order += k + (0 if self.margin is None else self.margin.pairs)
        self.struct.solver_end, self.struct.last_pivots = solver_end, begin
        if "scratch" not in self.arrays or self.arrays["scratch"].size < scratch:
            self._put("scratch", np.zeros(scratch))
        if "order" not in self.arrays or self.arrays["order"].size < order:
            before = self._preferred
            self._put("order", np.zeros(order, dtype=np.int64))
            self._preferred = self.arrays["order"][begin : begin + k]
            self._preferred[: before.size] = before
        self._reduced.clear()

    def layout_of(self, level: int, given: int) -> Layout:
        """Return where the arrays of a level lie, with so many inequality rows given."""
        known = self._layouts.get((level, given))
        if known is not None:
            return known
        at = np.zeros(lib.LAYOUT, dtype=np.int64)
        before, self.struct.given_rows = self.struct.given_rows, given
        lib.wbc_layout(self.struct, level, integers(at))
        self.struct.given_rows = before
        made = Layout(at.tolist(), level, self.tree.nv, self.forces is not None, self.costs)
        self._layouts[level, given] = made
        return made

    def _scratch_size(self) -> int:
        """Return how many numbers setting up the QPs needs."""
        tree, n = self.tree, self.n
        work = max(
            self._planned.largest * (n + 4) + tree.nv * (tree.nv + 16), 13 * tree.joints + 17 * n
        )
        if self.curved:
            work += 2 * tree.nv * (tree.nv + 3)
        if self.margin is not None:
            rows = self.margin.rows * tree.nv
            work = max(work, rows + self._margin_scratch_size(self.margin))
        motion = tree.motion_size if self.forces is not None else 0
        return self._planned.moving * (tree.frame_size + 6) + motion + work + n

    def _margin_scratch_size(self, margin: NativeMargin) -> int:
        """Return how many numbers the look-ahead of a margin needs."""
        there = 3 * self.tree.nv + 6 * self.tree.joints + 7 * margin.rows
        return there + 10 * (margin.bodies + margin.pairs)

    def _add_level(self, forces: NativeForces) -> None:
        """Add the torque level's arrays and settings."""
        self.arrays |= forces.arrays
        struct, layout = self.struct, forces.rows.forces
        struct.force, struct.bearing = forces.structs, forces.count
        struct.torque, struct.forces, struct.unit = 1, layout.size, layout.unit
        struct.passives, struct.bounded = forces.passive.size, forces.bounded.size
        struct.cones = forces.cones
