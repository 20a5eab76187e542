"""A trunk kept from tilting too far."""

from __future__ import annotations

from typing import Literal

from wbc.constraints import BrakingParameters, Limits, TiltLimit
from wbc.constraints.tilt_limit import TILT_BRAKING
from wbc.problem.constraint_spec import BuiltConstraint, ConstraintSpec
from wbc.problem.section import Name, Positive
from wbc.robot import Snapshot


class TiltSpec(ConstraintSpec):
    """What points up in a frame at the start is kept within an angle of the vertical."""

    type: Literal["tilt"]
    frame: Name = "base"
    """A link or other frame, such as the trunk's; base for the floating base."""
    angle: Positive
    """Largest tilt [rad]."""
    braking: Positive = TILT_BRAKING
    """Deceleration to count on before it [rad/s^2]."""

    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint."""
        braking = BrakingParameters(self.braking)
        constraint = TiltLimit.upright(start, self.frame, self.angle, braking=braking)
        return BuiltConstraint(lambda *_: constraint)
