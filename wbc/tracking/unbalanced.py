"""Where a motion asks for more than ground and joints have."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Unbalanced:
    """A stretch of time in which the motion cannot be balanced as it is.

    Attributes
    ----------
    what:
        ``CoP outside the feet`` [m], ``friction above the cone`` (the coefficient that is lacking),
        ``torque above the limit`` (part of it), ``force without a foot`` (part of the weight).
    by:
        How much at worst.
    start, end, worst:
        Times [s].
    where:
        The joint, or the feet that stand.
    """

    what: str
    by: float
    start: float
    end: float
    worst: float
    where: str

    def __str__(self) -> str:
        unit = 1e3 if self.what.startswith("CoP") else 100.0
        size = f"{self.by * unit:.0f} mm" if unit == 1e3 else f"{self.by * unit:.0f} %"
        if self.what.startswith("friction"):
            size = f"{self.by:.2f}"
        span = f"{self.start:.2f} to {self.end:.2f} s, worst at {self.worst:.2f} s"
        return f"{self.what} by {size} ({self.where}; {span})"
