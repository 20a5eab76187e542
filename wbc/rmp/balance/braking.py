"""How a coordinate may be accelerated so that it can still be stopped before its limit."""

from __future__ import annotations

import casadi as ca


def acceleration_range(
    position: ca.SX,
    rate: ca.SX,
    limits: tuple[float, float],
    strength: tuple[ca.SX | float, ca.SX | float],
    dt: float,
    insist: float = 1.0,
) -> tuple[ca.SX, ca.SX]:
    """Return the (least, greatest) acceleration for the coming ``dt``, each of ``position``'s size.

    After ``dt`` at the greatest, braking with all strength stops the coordinate at its upper limit.
    With the rate r1 after ``dt`` that is (rate + r1) dt/2 + r1^2 / (2 strength) = room: along the
    limit the motion is full speed, then full brake. A coordinate already out of its limits, or too
    fast for them, is brought back with ``insist`` times the strength, not in one tick.

    Parameters
    ----------
    position, rate:
        (n,), of any unit and its rate.
    limits:
        (lower, upper); an infinite one does not limit.
    strength:
        Greatest deceleration of a motion (downward, upward), > 0, (n,) or a number.
    dt:
        [s].
    insist:
        1 for limits that must be within reach; more where a slack shows what the brake lacks.
    """
    (lower, upper), (down, up) = limits, strength
    greatest = _ceiling(upper - position, rate, up, dt, insist) if upper < ca.inf else ca.inf
    least = -_ceiling(position - lower, -rate, down, dt, insist) if lower > -ca.inf else -ca.inf
    # Limits less than a tick's way apart would cross.
    ones = ca.SX.ones(position.shape)
    return ones * ca.fmin(least, greatest), ones * greatest


def _ceiling(room: ca.SX, rate: ca.SX, strength: ca.SX | float, dt: float, insist: float) -> ca.SX:
    """Return the greatest acceleration (n,) from which ``strength`` stops within ``room``."""
    left = room - rate * dt / 2
    # r1^2 / (2 s) + r1 dt / 2 = left; the fmax keeps the root real where the other branch holds.
    stopping = ca.sqrt((strength * dt / 2) ** 2 + 2 * strength * ca.fmax(left, 0.0))
    # Out of room: back to the limit within dt, as far as is insisted.
    after = ca.if_else(left > 0.0, stopping - strength * dt / 2, 2 * left / dt)
    return ca.fmax((after - rate) / dt, -insist * strength)
