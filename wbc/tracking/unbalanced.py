"""Intervals in which a motion violates the limits of ground and joints."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Unbalanced:
    """An interval in which the motion is not feasible as it is.

    Attributes
    ----------
    what:
        ``CoP outside the feet`` [m], ``friction above the cone`` (the missing coefficient),
        ``torque above the limit`` (part of it), ``force without a foot`` (part of the weight). Of
        constraints: ``sole slides`` [m], ``margin broken`` [m], ``joint limit passed`` [rad],
        ``speed above the limit``, ``acceleration above the motor's`` (parts of these).
    by:
        Largest excess.
    start, end, worst:
        Times [s].
    where:
        The joint, the bodies, or the feet that stand.
    """

    what: str
    by: float
    start: float
    end: float
    worst: float
    where: str

    def __str__(self) -> str:
        span = f"at {self.worst:.2f} s"
        if self.end > self.start:
            span = f"{self.start:.2f} to {self.end:.2f} s, worst {span}"
        return f"{self.what} by {self.size} ({self.where}; {span})"

    @property
    def size(self) -> str:
        """Largest excess, with its unit."""
        if self.what.startswith("friction"):
            return f"{self.by:.2f}"
        if self.what.startswith("joint limit"):
            return f"{self.by:.2g} rad"
        if self.what.startswith(("CoP", "sole", "margin")):
            return f"{1e3 * self.by:.3g} mm" if self.by < 1.0 else f"{self.by:.3g} m"
        of = " of the weight" if self.what.startswith("force") else ""
        return f"{100.0 * self.by:.0f} %{of}"
