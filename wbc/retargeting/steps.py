"""A retargeted walk for a walker: its footsteps, and what the arms do meanwhile."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from wbc.errors import InvalidInputError
from wbc.gait import Footstep
from wbc.gait.legs import SIDES
from wbc.gait.swing import turned
from wbc.retargeting.footsteps import Footprint
from wbc.retargeting.result import Retargeted
from wbc.validate import Array, finite_number

RAMP = (0.4, 0.7)  # parts of their length of the first steps, and of the last ones


def footsteps(motion: Retargeted, count: int) -> list[Footstep]:
    """Return ``count`` footsteps of a retargeted walk, each seen from the one before.

    For :meth:`wbc.gait.Walker.follow` with ``relative=True``: the walk in order, then its last
    stride again and again; first and last steps are shorter, and the last one ends beside the other
    foot.

    Raises
    ------
    InvalidInputError
        A motion in which feet do not take turns for a stride at least: three footprints.
    """
    count = int(finite_number("footsteps, count", count, least=2.0))
    prints = in_turn(motion)
    if len(prints) < 3:
        raise InvalidInputError(
            f"footsteps: {motion.source} has {len(prints)} footprints in turn; a stride takes three"
        )
    dt = motion.targets.dt
    steps = []
    for before, after in pairwise(prints):
        x, y = turned(-float(before.pose[2]))[:2, :2] @ (after.pose[:2] - before.pose[:2])
        turn = math.remainder(float(after.pose[2] - before.pose[2]), math.tau)
        air = [one for one in prints if one.foot == after.foot and one.end <= after.first]
        last = max((one.end for one in air), default=None)
        duration = None if last is None else (after.first - last + 1) * dt
        steps.append(Footstep(after.foot, float(x), float(y), turn, duration))
    known = [one.duration for one in steps if one.duration is not None]
    usual = float(np.mean(known)) if known else None
    steps = [Footstep(s.foot, s.x, s.y, s.yaw, s.duration or usual) for s in steps]
    found = [steps[k] if k < len(steps) else steps[_again(k, len(steps))] for k in range(count)]
    parts = np.ones(count)
    for k, part in enumerate(RAMP[: count // 2]):
        parts[k] = min(parts[k], part)
        parts[-2 - k] = min(parts[-2 - k], part)
    parts[-1] = 0.0
    return [
        Footstep(one.foot, part * one.x, one.y, min(1.0, part) * one.yaw, one.duration)
        for one, part in zip(found, parts.tolist(), strict=True)
    ]


def in_turn(motion: Retargeted) -> list[Footprint]:
    """Return the footprints in order of time, as long as feet take turns."""
    prints = sorted(motion.targets.feet.prints, key=lambda one: (one.first, one.end))
    found = prints[:1]
    for one in prints[1:]:
        if one.foot == found[-1].foot:
            break
        found.append(one)
    return found


def stride(motion: Retargeted) -> tuple[float, float]:
    """Return when the last whole stride begins, and how long it takes [s].

    Raises
    ------
    InvalidInputError
        No foot comes down twice.
    """
    dt, found = motion.targets.dt, []
    for side in SIDES:
        firsts = [one.first for one in in_turn(motion) if one.foot == side and one.first > 0]
        found += [(a * dt, (b - a) * dt) for a, b in pairwise(firsts)]
    if not found:
        raise InvalidInputError(f"stride: in {motion.source} no foot comes down twice")
    return max(found)


def posture_at(motion: Retargeted, time: float) -> Array:
    """Return the configuration (nq,) of a walk that goes on, ``time`` after its stride began [s].

    Before that it is where the stride begins.
    """
    begin, period = stride(motion)
    at = begin + (math.fmod(time, period) if time > 0.0 else 0.0)
    return motion.q[min(round(at / motion.targets.dt), len(motion) - 1)]


def _again(k: int, count: int) -> int:
    """Return which of ``count`` steps is made as number ``k``, when the last stride is repeated."""
    return count - 2 + (k - count) % 2
