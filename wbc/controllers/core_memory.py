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

# What the core says: enum status of source/core.h.
INFEASIBLE, UNSOLVED, DONE, NOT_FINITE = lib.INFEASIBLE, lib.UNSOLVED, lib.DONE, lib.NOT_FINITE
NOT_MEASURED, LEADS_INSIDE, MORE_ROWS = lib.NOT_MEASURED, lib.LEADS_INSIDE, lib.MORE_ROWS
REDUCED = lib.REDUCED
NULL, NOTHING = ffi.NULL, np.empty(0)


class CoreMemory:
    """Arrays and structures that the core reads, and what it is called with.

    Parameters
    ----------
    rows:
        What the torque level adds; None at the velocity level.
    margin:
        Between the robot's bodies; None: no rows of it.
    solver:
        Of the first level: the core itself, or ProxQP, which gets its QP reduced. None: no one's.
    added:
        (held,) what is added to the errors of loops and gears: others write it.
    kept:
        Whether rows of costs are kept for who looks at them.

    Attributes
    ----------
    arrays:
        What it reads and works in, by the names of ``wbc_plan`` in source/core.h.
    struct:
        The plan, a pointer to it.
    tree, blocks:
        The structs that it reads besides, but for the forces'.
    said:
        What the core said last.
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
        added: Array,
        kept: bool,
    ) -> None:
        self.tree, self.margin, self.levels = tree, margin, len(plan.levels)
        self.curved = any(part.second for part in parts)
        self.kept = kept or self.levels > 1 or self.curved
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
        self.arrays |= {"damping": plan.decision.damping.copy(), "limit": limit, "added": added}
        self.blocks = ffi.new("wbc_block[]", self._planned.blocks)
        settings = {"dt": dt, "mass": robot.mass, "unit": 1.0, "eps": 1e-8, "most": 1000}
        self.struct = ffi.new("wbc_plan *", {**self._planned.counts, **settings})
        self.struct.levels, self.struct.curved = self.levels, self.curved
        self.struct.wide = self.n if self._planned.of_forces else tree.nv
        if limits is not None:
            self.struct.limited, self.struct.recovery = True, limits.recovery
            self.struct.braked = limits.braking == "bounded"
        bent = any(isinstance(part.task, Mechanics) and part.task.bends for part in parts)
        self.struct.closing = bent and rows is None and solver is not None
        self._usual, self._outside = np.zeros(0, dtype=np.int64), False
        self._point(solver)
        self._tick: Any = lib.wbc_problem if solver is None else lib.wbc_tick
        self._state_pointer = doubles(self.state)
        self._measured = b""  # q and v
        self._layouts: dict[tuple[int, int], Layout] = {}
        self._reduced: dict[int, QP] = {}  # by its number of rows
        self.said, self.out, self.below = DONE, NOTHING, NOTHING
        self._fit(0)
        self.layout, self.given_rows = self.layout_of(0, 0), 0

    def _planned_arrays(self, robot: Robot) -> dict[str, NDArray[Any]]:
        """Return what blocks are about, and what ticks keep of them."""
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
        if self.kept:
            size = self.costs * (n + 2) + self.levels * nv * (1 + nv * self.curved)
            arrays["rows"] = np.zeros(size)
        if planned.moments:
            arrays["moments"] = np.zeros(planned.moments * (n - nv))
        return arrays

    def _point(self, solver: ActiveSet | ProxQP | None) -> None:
        """Let the struct point at all that it needs, of both levels."""
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
        """Run the core in memory that is the tick's own, as its evidence; return what it said.

        Parameters
        ----------
        measured:
            q, and v behind it.
        state:
            What the core found there before; None: it looks now.
        solve:
            Whether the QP is solved, if that is for the core.
        """
        known, layout, struct = NULL, self.layout, self.struct
        if state is not None:
            self.state[:] = state[: self.state.size]
            known = self._state_pointer
        self.out = NOTHING  # that of a tick which nobody kept is free to be taken again
        self.out = out = np.empty(layout.out)
        struct.out = doubles(out)
        if layout.below:
            self.below = np.empty(layout.below)
            struct.below = doubles(self.below)
        self._measured = measured
        function = self._tick if solve else lib.wbc_problem
        self.said = said = function(struct, known, measured, NULL)
        return said

    @property
    def asked(self) -> Any:
        """A pointer to q and v of the last call."""
        return doubles(self._measured)

    def accept(self, x: bytes, z: bytes, scale: float, iterations: int) -> bool:
        """Whether an answer of the reduced QP makes one of the level: see :class:`Reduced`."""
        self.said = lib.wbc_answer(self.struct, doubles(x), doubles(z), scale, iterations)
        return bool(self.said == DONE)

    def solve(self) -> bool:
        """Whether the core's active-set method does."""
        self.said = lib.wbc_answer(self.struct, NULL, NULL, 1.0, 0)
        return bool(self.said == DONE)

    def pose_level(self, level: int) -> int:
        """Write the QP of a level below the first."""
        return int(lib.wbc_pose(self.struct, self.asked, NULL, level))

    def solve_level(self, level: int) -> int:
        """Solve a level's QP, in the core; of the first REDUCED may be said."""
        self.said = int(lib.wbc_solve(self.struct, level))
        return self.said

    def descend(self) -> int:
        """Solve the levels below the first, whose answer was written, and write the command."""
        self.said = int(lib.wbc_descend(self.struct, self.asked, NULL))
        return self.said

    def finish(self) -> int:
        """Write the command of the last level that was solved."""
        self.said = int(lib.wbc_finish(self.struct, self.asked, NULL))
        return self.said

    def gaps(self, snapshot: Snapshot, v: Array) -> Array:
        """Return how far loops and gears are open (held,) where a command leads [m, rad]."""
        gaps, at = np.empty(self.held), (snapshot.native_state.array, snapshot.q, v)
        lib.wbc_gaps(self.struct, *map(doubles, at), doubles(gaps))
        return gaps

    def cost(self, level: int) -> tuple[Array, Array]:
        """Return P (n, n) and g (n,) of one level, or of all (-1), from the rows that are kept."""
        P, g = np.empty((self.n, self.n)), np.empty(self.n)
        lib.wbc_cost(self.struct, self.asked, NULL, level, doubles(P), doubles(g))
        return P, g

    @property
    def last_pivots(self) -> bytes:
        """Columns that the last tick eliminated: the next prefers them, where ProxQP is asked."""
        return self._usual.tobytes() if self._outside else b""

    @last_pivots.setter
    def last_pivots(self, columns: bytes) -> None:
        if len(columns) == self._usual.nbytes:
            self._usual[:] = np.frombuffer(columns, dtype=np.int64)

    @property
    def qp(self) -> QP:
        """What the core left to be solved, a QP without equalities: views on its memory."""
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
        """Of the last answer of the first level."""
        return int(self.out[self.layout.found][3])

    # ------------------------------------------------------------------ what is written

    def write_limits(self, limits: Limits) -> None:
        """Take over those that were assigned."""
        self.arrays["limit"][:] = limits.numbers(self._slow)
        self.struct.recovery = limits.recovery

    def write_bounds(self, bounds: Bounds | None) -> None:
        """Take over inequality rows that were worked out in Python, and what they push at."""
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
        """Make room to work in for so many given rows."""
        n, m = self.n, self._m + given
        k = self.k + (self.costs if self.levels > 1 else 0)
        sizes = np.empty(3, dtype=np.int64)
        loops = 0 if self.forces is None else self._planned.mechanics
        lib.wbc_sizes(n, k, m, loops, integers(sizes))
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
            before = self._usual
            self._put("order", np.zeros(order, dtype=np.int64))
            self._usual = self.arrays["order"][begin : begin + k]
            self._usual[: before.size] = before
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
        """Return how many numbers looking where an answer leads needs."""
        there = 3 * self.tree.nv + 6 * self.tree.joints + 7 * margin.rows
        return there + 10 * (margin.bodies + margin.pairs)

    def _add_level(self, forces: NativeForces) -> None:
        """Add what the torque level needs to the arrays and to the struct."""
        self.arrays |= forces.arrays
        struct, layout = self.struct, forces.rows.forces
        struct.force, struct.bearing = forces.structs, forces.count
        struct.torque, struct.forces, struct.unit = 1, layout.size, layout.unit
        struct.passives, struct.bounded = forces.passive.size, forces.bounded.size
        struct.cones = forces.cones
