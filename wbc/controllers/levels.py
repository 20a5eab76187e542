"""Levels of a tick that the core alone does not solve.

For singular tasks and bounded braking the QP of each level is modified in the core's memory before
it is solved: see :mod:`wbc.controllers.singular` and :mod:`wbc.controllers.braking`. And if the
core's first attempt at a level fails, or another solver was chosen for the first one, that is
called here.
"""

from __future__ import annotations

import numpy as np

from wbc.constraints.limits import Box, Limits
from wbc.controllers.braking import relax_box, scale_gains_to_brake
from wbc.controllers.core_memory import DONE, LEADS_INSIDE, MORE_ROWS, NOT_FINITE, NOT_MEASURED
from wbc.controllers.core_plan import TOLERANCE, CorePlan
from wbc.controllers.core_tick import CoreTick
from wbc.controllers.first_level import FirstLevel
from wbc.controllers.outcome import Outcome
from wbc.controllers.plan import LevelPlan
from wbc.controllers.singular import Singularity, reduce_singular
from wbc.laws import Rows
from wbc.qp.active_set import NAME, NO_RESIDUALS
from wbc.qp.problem import check_qp
from wbc.qp.solution import Solution, Status
from wbc.robot import Snapshot
from wbc.validate import Array

RETRIED = "another attempt at the QP"


class Levels:
    """Solves the levels of ticks that the core alone does not.

    ``joint_weights``: (nv,) of the damping: the metric of least motions.
    ``torque``: whether it is for the torque level, which has neither singular rows nor bounded
    braking.

    ``bounds_braking``: whether the acceleration limits bound how joints slow down.
    ``modifies_qps``: whether QPs are changed before they are solved.
    """

    def __init__(
        self,
        plan: LevelPlan,
        first: FirstLevel,
        limits: Limits | None,
        dt: float,
        joint_weights: Array,
        torque: bool,
    ) -> None:
        self.first, self._plan, self._limits, self._dt = first, plan, limits, dt
        self._root = np.sqrt(joint_weights)
        self.bounds_braking = limits is not None and limits.braking == "bounded" and not torque
        singular = any(task.singular_threshold for task in plan.motion)
        self.modifies_qps = self.bounds_braking or (singular and not torque)

    def solve(
        self,
        core: CorePlan,
        core_tick: CoreTick,
        snapshot: Snapshot,
        box: Box | None,
        simple: bool,
        deadline_over: bool,
    ) -> Outcome:
        """Solve the levels of a tick that the core did not solve, all or those below others.

        ``box``: bounds on v+ in place of the limits'; None: the limits'.
        ``simple``: whether the core has already tried to solve all levels.
        """
        names = self._plan.decision.names
        status: int | None = core.memory.status
        if core_tick.solved:
            return self._with_left_out(core, core_tick, deadline_over).within_limits(names)
        if simple:
            status = status if core.solves else None
        else:
            if box is not None:
                for there, bound in zip(core_tick.box, box, strict=True):
                    there[:] = bound
            status = self._one_by_one(core, core_tick, snapshot)
            if core_tick.solved:
                return Outcome(core_tick).within_limits(names)
        if status in (NOT_MEASURED, MORE_ROWS, LEADS_INSIDE):
            return Outcome(core_tick, _not_measured(core_tick))
        if status == NOT_FINITE:
            check_qp(core_tick.qp_of(0))
        workspace = None if box is not None else self._plan.workspace
        solution = self.first.solve(core_tick, status, workspace, deadline_over)
        if not solution.solved:
            if deadline_over:
                core_tick.skipped += (RETRIED,)
            return Outcome(core_tick, solution)
        core_tick.set_solution(0, solution)
        status = core.memory.descend()
        if status == LEADS_INSIDE:
            return Outcome(core_tick, _not_measured(core_tick))
        core_tick.solved = status == DONE
        if core.memory.struct.closing:  # closing loops may have solved it again
            core_tick.first_solution = None
        return self._with_left_out(core, core_tick, deadline_over).within_limits(names)

    def relaxed_box(self, core_tick: CoreTick, snapshot: Snapshot) -> Box | None:
        """Return the box relaxed as far as rows need it; None: it is relaxed already."""
        if self._limits is None:
            return None
        qp, nv = core_tick.qp_of(0), snapshot.v.size
        relaxed = relax_box(qp, self._limits, snapshot, self._dt, self.first.solve_once)
        return None if relaxed is None else (relaxed.lower[:nv], relaxed.upper[:nv])

    def _one_by_one(self, core: CorePlan, core_tick: CoreTick, snapshot: Snapshot) -> int | None:
        """Modify and solve level by level; return the core's status at the first."""
        memory = core.memory
        core_tick.singular |= self._modify_qp(core, core_tick, 0, snapshot)
        if not core.solve_level(core_tick, 0):
            status = memory.status if core.solves else None
            solution = self.first.solve(core_tick, status, self._plan.workspace, False)
            if not solution.solved:
                return status
            core_tick.set_solution(0, solution)
        for level in range(1, len(self._plan.levels)):
            if not self._solve_below(core, core_tick, level, snapshot):
                break
        core_tick.solved = memory.finish() == DONE
        return DONE

    def _with_left_out(self, core: CorePlan, core_tick: CoreTick, deadline_over: bool) -> Outcome:
        """Make another attempt at the levels that the core left out."""
        memory, last = core.memory, core_tick.level
        if not core_tick.is_whole and not (deadline_over or memory.struct.closing):
            for level in range(last + 1, len(self._plan.levels)):
                if not self._solve_below(core, core_tick, level):
                    break
            if core_tick.level > last and memory.finish() == LEADS_INSIDE:
                return Outcome(core_tick, _not_measured(core_tick))
        return Outcome(core_tick)

    def _solve_below(
        self, core: CorePlan, core_tick: CoreTick, level: int, snapshot: Snapshot | None = None
    ) -> bool:
        """Solve a level below the first; without a solution what was found above it stays.

        ``snapshot``: of ticks whose QPs are modified.
        """
        memory, singular = core.memory, dict[str, Singularity]()
        above = memory.below.copy()  # a level overwrites that above it
        if memory.pose_level(level) == DONE:
            if snapshot is not None:
                singular = self._modify_qp(core, core_tick, level, snapshot)
            solved = core.solve_level(core_tick, level)
            if not solved:
                found = self.first.solve_once(core_tick.qp_of(level))
                solved = found.solved and found.residuals.primal <= TOLERANCE
                if solved:
                    core_tick.set_solution(level, found)
            if solved:
                core_tick.singular |= singular
                return True
        memory.below[:] = above
        return False

    def _modify_qp(
        self, core: CorePlan, core_tick: CoreTick, level: int, snapshot: Snapshot
    ) -> dict[str, Singularity]:
        """Reduce the demand of singular rows, and gains so that joints can stop.

        Return how singular tasks are, by name.
        """
        if not self.modifies_qps:
            return {}
        found = dict[str, Singularity]()
        rows, qp = core.cost_rows(core_tick, level), core_tick.qp_of(level)
        if any(row.singular_threshold for _, row in rows):
            held = Rows(qp.A, qp.b, np.ones(qp.b.size))
            soft = [row for task, row in rows if task in self._plan.soft]
            names = [task.name for task, _ in rows if task not in self._plan.soft]
            full = [row for task, row in rows if task not in self._plan.soft]
            reduced, singular = reduce_singular(full, [held, *soft], self._root)
            for before, after in zip(full, reduced, strict=True):
                if after.target is not before.target:
                    lost = before.target - after.target
                    qp.g[:] += (np.square(before.weight) * lost) @ before.matrix
                    before.target[:] = after.target
            found = {names[k]: one for k, one in singular.items()}
        if self.bounds_braking and self._limits is not None:
            scale_gains_to_brake(qp, [row for _, row in rows], self._limits, snapshot, self._dt)
        return found


def _not_measured(core_tick: CoreTick) -> Solution:
    """Return the failed solution of a tick whose margin rows the core could not write."""
    a, message = core_tick.views, "not measured by the core"
    x, y, z, box = (np.full(one.size, np.nan) for one in (a.x, a.y, a.z, a.z_box))
    return Solution(x, y, z, box, Status.FAILED, NO_RESIDUALS, 0, 0.0, NAME, message=message)
