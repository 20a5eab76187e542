"""What came of the levels of one tick."""

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
    """What came of the levels of one tick."""

    found: CoreTick  # their QPs and answers
    # The first level's solution, if it could not be solved; None: it was.
    failed: Solution | None = None
    step_scale: float = 1.0  # the part of the velocity that is safe to command

    @property
    def solved(self) -> bool:
        """Whether there is a command."""
        return self.failed is None

    @property
    def solution(self) -> Solution:
        """That of the last level, or the first one's failure."""
        return self.found.solution if self.failed is None else self.failed

    @property
    def velocity(self) -> Array:
        """The velocity at the end of the tick (nv,)."""
        return self.found.velocity

    @property
    def box(self) -> Box:
        """The bounds (nv,), (nv,) on the velocity that the first level kept."""
        return self.found.box

    def within_limits(self, names: tuple[str, ...]) -> Outcome:
        """Refuse an answer outside the limits in the robot's own units, whatever it rests on.

        Without limits what a robot's state may have is one: where it led could not be looked at.
        Residuals may be judged relative to the numbers of the QP, which may be huge; joints are
        not. ``names`` are those of the unknowns.
        """
        if self.failed is not None:
            return self
        v, (lower, upper) = self.found.velocity, self.box
        excess = np.maximum(lower - v, v - upper)
        worst = int(excess.argmax())
        if excess.item(worst) <= TOLERANCE:  # NaN is not
            if np.abs(v).max() <= LARGEST:
                return self
            worst, where = int(np.abs(v).argmax()), f"beyond {LARGEST:g}, which no state may have"
        else:
            where = f"outside its limits [{lower[worst]:.6g}, {upper[worst]:.6g}]"
        message = f"{names[worst]} at {v[worst]:.6g}, {where}: not commanded"
        refused = self.found.solution._replace(status=Status.CONTRADICTED, message=message)
        return self._replace(failed=refused)
