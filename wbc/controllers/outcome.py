"""The result of solving the levels of one tick."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.constraints.limits import Box
from wbc.controllers.core_plan import TOLERANCE
from wbc.controllers.core_tick import CoreTick
from wbc.qp.solution import Solution, Status
from wbc.robot.tree import LARGEST
from wbc.validate import Array


class Outcome(NamedTuple):
    """The result of solving the levels of one tick."""

    core_tick: CoreTick  # their QPs and answers
    # The first level's solution, if it could not be solved; None: it was.
    failed: Solution | None = None
    step_scale: float = 1.0  # the part of the velocity that is safe to command

    @property
    def solved(self) -> bool:
        """Whether there is a command."""
        return self.failed is None

    @property
    def solution(self) -> Solution:
        """The last level's solution, or the first level's failure."""
        return self.core_tick.solution if self.failed is None else self.failed

    @property
    def velocity(self) -> Array:
        """The velocity at the end of the tick (nv,)."""
        return self.core_tick.velocity

    @property
    def box(self) -> Box:
        """The bounds (nv,), (nv,) on the velocity that the first level kept."""
        return self.core_tick.box

    def within_limits(self, names: tuple[str, ...]) -> Outcome:
        """Fail a solution that is outside the limits in the robot's own units.

        Residuals may be accepted relative to the QP's numbers, which may be huge; a joint's
        velocity may not. Without limits the largest velocity of a state counts. ``names``: of the
        unknowns.
        """
        if self.failed is not None:
            return self
        v, (lower, upper) = self.core_tick.velocity, self.box
        excess = np.maximum(lower - v, v - upper)
        worst = int(excess.argmax())
        if excess.item(worst) <= TOLERANCE:  # NaN is not
            if np.abs(v).max() <= LARGEST:
                return self
            worst, where = int(np.abs(v).argmax()), f"beyond {LARGEST:g}, which no state may have"
        else:
            where = f"outside its limits [{lower[worst]:.6g}, {upper[worst]:.6g}]"
        message = f"{names[worst]} at {v[worst]:.6g}, {where}: not commanded"
        refused = self.core_tick.solution._replace(status=Status.CONTRADICTED, message=message)
        return self._replace(failed=refused)
