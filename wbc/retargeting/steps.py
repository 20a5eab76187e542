"""A retargeted walk for a walker: its footsteps, and the postures of a stride."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from wbc.errors import InvalidInputError
from wbc.gait import Footstep
from wbc.gait.legs import SIDES
from wbc.gait.swing import turned
from wbc.kinds import whole_number
from wbc.retargeting.footsteps import Footprint
from wbc.retargeting.result import Retargeted
from wbc.validate import Array

RAMP = (0.4, 0.7)  # factors on the length of the first two and, reversed, the last two steps


def footsteps(motion: Retargeted, count: int) -> list[Footstep]:
    """Return ``count`` footsteps of a retargeted walk, each relative to the one before.

    For :meth:`wbc.gait.Walker.follow` with ``relative=True``: the steps of the walk, then its last
    stride repeatedly. The first and last steps are shortened, and the last one ends beside the
    other foot.

    Raises
    ------
    InvalidInputError
        Feet do not alternate for at least a stride: three footprints.
    """
    count = whole_number("footsteps, count", count, least=2)
    prints = alternating_footprints(motion)
    if len(prints) < 3:
        raise InvalidInputError(
            f"footsteps: {motion.source} has {len(prints)} footprints in turn; a stride takes three"
        )
    dt, steps = motion.targets.dt, []
    swings = [(b.first - a.end + 1) * dt for a, b in zip(prints, prints[2:], strict=False)]
    durations = [float(np.mean(swings)), *swings]  # that of the first step is not known
    for (before, after), duration in zip(pairwise(prints), durations, strict=True):
        x, y = turned(-float(before.pose[2]))[:2, :2] @ (after.pose[:2] - before.pose[:2])
        yaw = math.remainder(float(after.pose[2] - before.pose[2]), math.tau)
        steps.append(Footstep(after.foot, float(x), float(y), yaw, duration))
    many = len(steps)  # after these the last two are repeated
    found = [steps[k if k < many else (k - many) % 2 - 2] for k in range(count)]
    factors = np.ones(count)
    for k, factor in enumerate(RAMP[: count // 2]):
        factors[k] = min(factors[k], factor)
        factors[-2 - k] = min(factors[-2 - k], factor)
    factors[-1] = 0.0
    return [
        Footstep(one.foot, factor * one.x, one.y, factor * one.yaw, one.duration)
        for one, factor in zip(found, factors.tolist(), strict=True)
    ]


def alternating_footprints(motion: Retargeted) -> list[Footprint]:
    """Return the footprints in order of time, as long as the feet alternate."""
    prints = sorted(motion.targets.feet.prints, key=lambda one: (one.first, one.end))
    found = prints[:1]
    for one in prints[1:]:
        if one.foot == found[-1].foot:
            break
        found.append(one)
    return found


def stride(motion: Retargeted) -> tuple[float, float]:
    """Return when the last whole stride begins, and how long it takes [s].

    Raises InvalidInputError: no foot touches down twice.
    """
    dt, found = motion.targets.dt, []
    for side in SIDES:
        firsts = [
            one.first
            for one in alternating_footprints(motion)
            if one.foot == side and one.first > 0
        ]
        found += [(a * dt, (b - a) * dt) for a, b in pairwise(firsts)]
    if not found:
        raise InvalidInputError(f"stride: in {motion.source} no foot touches down twice")
    return max(found)


def posture_at(motion: Retargeted, time: float) -> Array:
    """Return the configuration (nq,) of a repeated stride, ``time`` after its beginning [s].

    Before that it is the stride's first.
    """
    begin, period = stride(motion)
    phase = begin + (math.fmod(time, period) if time > 0.0 else 0.0)
    return motion.q[min(round(phase / motion.targets.dt), len(motion) - 1)]
