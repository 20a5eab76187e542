"""Levels of a tick that the core alone does not settle.

Where tasks are singular or joints brake at bounded rates, the QP of each level is changed before it
is solved, in the core's own memory: see :mod:`wbc.controllers.singular` and
:mod:`wbc.controllers.braking`. And where the core's first attempt at the first level gives no
answer, or another solver is to give it, it is asked here.
"""

from __future__ import annotations

import numpy as np

from wbc.constraints.limits import Box, Limits
from wbc.controllers.braking import relax_box, scale_gains_to_brake
from wbc.controllers.core_memory import DONE, LEADS_INSIDE, MORE_ROWS, NOT_FINITE, NOT_MEASURED
from wbc.controllers.core_plan import CorePlan
from wbc.controllers.core_tick import CoreTick
from wbc.controllers.first_level import FirstLevel
from wbc.controllers.outcome import Outcome
from wbc.controllers.plan import LevelPlan
from wbc.controllers.singular import reduce_singular
from wbc.laws import Rows
from wbc.qp.active_set import NAME, NO_RESIDUALS
from wbc.qp.problem import check_qp
from wbc.qp.solution import Solution, Status
from wbc.robot import Snapshot
from wbc.validate import Array

RETRIED = "another attempt at the QP"


class Levels:
    """Solves the levels of ticks that are not plain.

    Parameters
    ----------
    joint_weights:
        (nv,) of the damping: which motion is the least.
    torque:
        Whether it is for the torque level, which knows neither singular rows nor bounded braking.

    Attributes
    ----------
    braked:
        Whether a joint's acceleration bounds how it slows down.
    looked_into:
        Whether QPs are changed before they are solved.
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
        self.braked = limits is not None and limits.braking == "bounded" and not torque
        singular = any(task.singular_threshold for task in plan.motion)
        self.looked_into = self.braked or (singular and not torque)

    def solve(
        self,
        core: CorePlan,
        found: CoreTick,
        snapshot: Snapshot,
        box: Box | None,
        simple: bool,
        hurried: bool,
    ) -> Outcome:
        """Return what comes of the levels of a tick that the core did not solve.

        Parameters
        ----------
        box:
            On v+, in place of the limits'; None: those.
        simple:
            Whether the core was asked for all of it.
        hurried:
            Whether the deadline is over.
        """
        names = self._plan.decision.names
        said: int | None = core.memory.said
        if simple:
            said = said if core.solves else None
        else:
            if box is not None:
                for there, bound in zip(found.box, box, strict=True):
                    there[:] = bound
            said = self._one_by_one(core, found, snapshot)
            if found.solved:
                return Outcome(found).within_limits(names)
        if said in (NOT_MEASURED, MORE_ROWS, LEADS_INSIDE):
            return Outcome(found, _not_measured(found))
        if said == NOT_FINITE:
            check_qp(found.qp_of(0))
        workspace = None if box is not None else self._plan.workspace
        solution = self.first.solve(found, said, workspace, hurried)
        if not solution.solved:
            if hurried:
                found.hurried += (RETRIED,)
            return Outcome(found, solution)
        found.take(solution)
        found.solved = core.memory.descend() in (DONE, LEADS_INSIDE)
        if core.memory.struct.closing:  # which may have solved it again
            found.first = None
        return Outcome(found).within_limits(names)

    def relaxed_box(self, found: CoreTick, snapshot: Snapshot) -> Box | None:
        """Return the box opened as far as rows need it; None: it is all open already."""
        if self._limits is None:
            return None
        qp, nv = found.qp_of(0), snapshot.v.size
        relaxed = relax_box(qp, self._limits, snapshot, self._dt, self.first.solve_once)
        return None if relaxed is None else (relaxed.lower[:nv], relaxed.upper[:nv])

    def _one_by_one(self, core: CorePlan, found: CoreTick, snapshot: Snapshot) -> int | None:
        """Solve level by level what is looked into; return what the core said of the first."""
        memory = core.memory
        for level in range(len(self._plan.levels)):
            if level and memory.pose_level(level) != DONE:
                break
            if self.looked_into:
                self._look_into(core, found, level, snapshot)
            if core.solve_level(found, level):
                continue
            if level:
                break
            said = memory.said if core.solves else None
            solution = self.first.solve(found, said, self._plan.workspace, False)
            if not solution.solved:
                return said
            found.take(solution)
        found.solved = memory.finish() == DONE
        return DONE

    def _look_into(self, core: CorePlan, found: CoreTick, level: int, snapshot: Snapshot) -> None:
        """Let singular rows ask for less, and gains be such that joints can stop."""
        rows, qp = core.rows_of(found, level), found.qp_of(level)
        if any(row.singular_threshold for _, row in rows):
            held = Rows(qp.A, qp.b, np.ones(qp.b.size))
            soft = [row for task, row in rows if task in self._plan.soft]
            names = [task.name for task, _ in rows if task not in self._plan.soft]
            eased = [row for task, row in rows if task not in self._plan.soft]
            less, singular = reduce_singular(eased, [held, *soft], self._root)
            for before, after in zip(eased, less, strict=True):
                if after.target is not before.target:
                    lost = before.target - after.target
                    qp.g[:] += (np.square(before.weight) * lost) @ before.matrix
                    before.target[:] = after.target
            found.singular |= {names[k]: one for k, one in singular.items()}
        if self.braked and self._limits is not None:
            scale_gains_to_brake(qp, [row for _, row in rows], self._limits, snapshot, self._dt)


def _not_measured(found: CoreTick) -> Solution:
    """Return what is said where the core has no QP: rows of its margin are not written."""
    a, message = found.views, "not measured by the core"
    x, y, z, box = (np.full(one.size, np.nan) for one in (a.x, a.y, a.z, a.z_box))
    return Solution(x, y, z, box, Status.FAILED, NO_RESIDUALS, 0, 0.0, NAME, message=message)
