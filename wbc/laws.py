"""From a task's residual to rows of a least-squares cost, at the velocity or acceleration level."""

from __future__ import annotations

import math
from typing import NamedTuple

from wbc.tasks.task import Residual
from wbc.validate import Array


class Rows(NamedTuple):
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
    singular_below:
        Singular values of ``matrix`` below which the target is held back; 0 for never.
    rate, bias:
        The target is ``-rate * error - bias``, in [1/s] and (k,); 0 and None for rows that are not
        of this form.
    """

    matrix: Array
    target: Array
    weight: Array
    damping: float = 0.0
    curvature: Array | None = None
    singular_below: float = 0.0
    rate: float = 0.0
    bias: Array | None = None


def velocity_law(
    residual: Residual,
    gain: float,
    dt: float,
    weight: Array,
    lm_damping: float = 0.0,
    singular_below: float = 0.0,
) -> Rows:
    """Return rows asking for ``d(error)/dt = -gain/dt * error``; the unknown is the velocity.

    A Gauss-Newton step of length ``gain`` towards a target out of reach swings back and forth
    unless its Hessian is above gain/2 of the true one. Hence half of gain times what a task says
    of the curvature left out is added as damping; it fades as the error does.
    """
    wanted = (-gain / dt) * residual.error
    wanted -= residual.bias
    damping = 0.5 * gain * residual.curvature_bound
    if lm_damping > 0.0:
        weighted = weight * residual.error
        damping += lm_damping * math.sqrt(float(weighted @ weighted))
    return Rows(
        residual.jacobian,
        wanted,
        weight,
        damping,
        residual.curvature,
        singular_below,
        gain / dt,
        residual.bias,
    )


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
