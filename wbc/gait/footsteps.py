"""Nominal footsteps of a walk at a velocity."""

from __future__ import annotations

import cmath
import math
from functools import lru_cache

from wbc.gait.command import Velocity
from wbc.gait.dcm import StepTimes, shift_gain
from wbc.gait.settings import GaitSettings

SIGN = {"left": 1.0, "right": -1.0}


def other(side: str) -> str:
    """Return the other foot."""
    return "right" if side == "left" else "left"


def nominal_step(gait: GaitSettings, support: str, heading: float, velocity: Velocity) -> complex:
    """Return the displacement [m] from the foot ``support`` to the next, in world axes, x + i y.

    The middle between the feet moves by v T, and they are the gait's width apart or more; sideways
    the leading foot makes all of it, so that the trailing one need not cross the other.

    ``heading``: of the stance foot [rad].
    """
    step = _step(SIGN[other(support)], velocity, gait.times.total, gait.width)
    return cmath.rect(1.0, heading) * step


def nominal_offset(gait: GaitSettings, foot: str, heading: float, velocity: Velocity) -> complex:
    """Return the DCM relative to a foot [m] at the beginning of its single support, likewise.

    For an endless walk: each step counts for exp(-omega T) of the one before, as in
    :func:`wbc.gait.dcm.dcm_offsets`, and every second one is the same, turned by 2 yaw_rate T: a
    geometric series.
    """
    sign = SIGN[other(foot)]
    gain, pair, rest = _endless_walk(sign, velocity, gait.times, gait.width, gait.omega)
    return gain * cmath.rect(1.0, heading) * pair / rest


@lru_cache(maxsize=2)  # of both feet: most walks are steady
def _endless_walk(
    sign: float, velocity: Velocity, times: StepTimes, width: float, omega: float
) -> tuple[float, complex, complex]:
    """Return the first step's gain on the DCM, two steps as seen from the foot, and 1 - q^2."""
    T = times.total
    decay = math.exp(-omega * T)
    q = decay * cmath.rect(1.0, velocity.yaw_rate * T)
    pair = _step(sign, velocity, T, width) + q * _step(-sign, velocity, T, width)
    return decay * shift_gain(omega, times.double), pair, 1.0 - q * q


@lru_cache(maxsize=2)
def _step(sign: float, velocity: Velocity, T: float, width: float) -> complex:
    """Return the step of a foot at the side ``sign``, as seen from the other: x + i y [m]."""
    vx, vy, yaw_rate = velocity
    is_leading = sign * vy > 0.0
    turn = cmath.rect(1.0, yaw_rate * T)
    middle = cmath.rect(T, 0.5 * yaw_rate * T) * complex(vx, 2.0 * vy if is_leading else 0.0)
    return middle + complex(0.0, 0.5 * sign * width) * (1.0 + turn)


def first_swing(velocity: Velocity) -> str:
    """Return the first swing foot: the leading one, sideways or in a turn, else the right one."""
    direction = velocity.vy if velocity.vy != 0.0 else velocity.yaw_rate
    return "left" if direction > 0.0 else "right"
