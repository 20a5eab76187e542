"""The CoM kept over the feet that stand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from wbc.constraints import ComSupport, Contact, Limits
from wbc.problem.constraint_spec import BuiltConstraint, ConstraintSpec
from wbc.problem.section import Names, NonNegative, default_of
from wbc.robot import Snapshot
from wbc.run.phase_support import PhaseSupport


class ComSupportSpec(ConstraintSpec):
    """The CoM is kept over the feet that stand."""

    type: Literal["com_support"]
    margin: NonNegative = default_of(ComSupport, "margin")
    """Distance from the edges of the support polygon [m]."""
    feet: Names | None = None
    """The feet that count; left out: those that the support holds, phase by phase."""

    def build(self, start: Snapshot, limits: Limits | None) -> BuiltConstraint:
        """Return the constraint, which is made anew for the feet that stand."""
        if self.feet is not None:
            ComSupport.over(start, self.feet, margin=self.margin)

        def during(snapshot: Snapshot, contacts: Sequence[Contact]) -> ComSupport | None:
            feet = self.feet or PhaseSupport.on("", contacts).feet
            return ComSupport.over(snapshot, feet, margin=self.margin) if feet else None

        return BuiltConstraint(during)
