"""The smoothest way from 0 to 1 between rest and rest: least integrated squared jerk."""

from __future__ import annotations

from typing import TypeVar

from wbc.validate import Array

Scalars = TypeVar("Scalars", float, Array)
# Largest slope of the curve, at half time.
PEAK = 1.875


def minimum_jerk(x: Scalars) -> Scalars:
    """Return s(x) = 10 x^3 - 15 x^4 + 6 x^5 for x in [0, 1] (Flash and Hogan 1985).

    Slope and curvature are zero at both ends.
    """
    return x**3 * (10.0 + x * (6.0 * x - 15.0))


def minimum_jerk_rates(x: float) -> tuple[float, float]:
    """Return ds/dx and d^2s/dx^2."""
    return 30.0 * (x * (1.0 - x)) ** 2, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)
