"""From a task's residual to rows of a least-squares cost, at the velocity or acceleration level."""

from __future__ import annotations

import math
from dataclasses import dataclass

from wbc.tasks.task import Residual
from wbc.validate import Array


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows ``matrix @ x = target`` to be met by the unknown x as well as ``weight`` asks.

    Attributes
    ----------
    matrix:
        (k, n).
    target:
        (k,).
    weight:
        (k,) factors applied before squaring.
    damping:
        Added to the diagonal of the quadratic cost.
    curvature:
        (n, n) added to the quadratic cost, possibly indefinite; None for none.
    """

    matrix: Array
    target: Array
    weight: Array
    damping: float = 0.0
    curvature: Array | None = None


def velocity_law(
    residual: Residual, rate_gain: float, weight: Array, lm_damping: float = 0.0
) -> Rows:
    """Return rows asking for ``d(error)/dt = -rate_gain * error``; the unknown is the velocity.

    ``rate_gain`` [1/s] is the task's gain divided by the time step.
    """
    wanted = -rate_gain * residual.error
    wanted -= residual.bias
    damping = 0.0
    if lm_damping > 0.0:
        weighted = weight * residual.error
        damping = lm_damping * math.sqrt(float(weighted @ weighted))
    return Rows(residual.jacobian, wanted, weight, damping, residual.curvature)


def acceleration_law(
    residual: Residual, drift: Array, v: Array, kp: float, kd: float, weight: Array
) -> Rows:
    """Return rows asking for ``e'' = -kp e - kd e'``; the unknown is the acceleration.

    ``kd = 2 sqrt(kp)`` is critical damping; ``drift`` is e'' at zero acceleration.
    """
    wanted = -kp * residual.error
    wanted -= kd * residual.rate(v)
    wanted -= drift
    return Rows(residual.jacobian, wanted, weight)
