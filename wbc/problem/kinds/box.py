"""The origin of a frame kept in a box."""

from __future__ import annotations

from typing import Literal

import numpy as np

from wbc.constraints import Limits, PositionBox
from wbc.problem.constraint_spec import BuiltConstraint, ConstraintSpec
from wbc.problem.section import Components, Name
from wbc.robot import Snapshot


class BoxSpec(ConstraintSpec):
    """The origin of a frame is kept in a box along the world's axes."""

    type: Literal["box"]
    frame: Name = "base"
    """A link, sole or other frame; base for the floating base."""
    lower: Components = (None, None, None)
    """Least x, y, z [m]; null: no bound."""
    upper: Components = (None, None, None)
    """Greatest x, y, z [m]; null: no bound."""

    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint."""
        lower = [-np.inf if end is None else end for end in self.lower]
        upper = [np.inf if end is None else end for end in self.upper]
        box = PositionBox(start.robot, self.frame, lower, upper, limits=limits)
        return BuiltConstraint(lambda *_: box)
