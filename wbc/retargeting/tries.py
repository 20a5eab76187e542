"""Tries at a motion: slower, or with less asked of it, until what is hard is kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from wbc.retargeting.by_tick import Progress
from wbc.retargeting.mending import mended
from wbc.retargeting.rounds import ASTRAY, ENOUGH, NEARLY, solved
from wbc.retargeting.scaling import MotionScale
from wbc.retargeting.smoothing import WholeMotion
from wbc.retargeting.tasks import RetargetWeights
from wbc.validate import Array

ROUNDS = 14  # of the whole motion at once, at most
# What is hard and cannot be kept is tried again, with so much less asked of the CoM, in so many
# times the time if joints would have to be faster or stronger.
TRIES, SOFTER, SLOWER = 6, 0.5, 1.2
# Joints that would be faster than they are by this and no more make the motion slower, by as much
# and a little but by no more than this at once, if what is mended in its own time is spoiled.
TOO_SLOW, MORE_SLOWLY, SLOWEST = 4.0, 0.03, 1.5
SPOILED = 1.5  # times the sum of squares of what is not mended
# Before all that more is asked of CoM, momentum and the long axis' lean: who can, does.
EAGER = {"com": 1.15, "momentum": 1.75, "lean": 20.0}

# From a scale and weights to the least squares of a motion, and the human's principal axes.
Problem = Callable[[MotionScale, RetargetWeights], tuple[WholeMotion, Array]]


@dataclass(frozen=True, eq=False)
class Tried:
    """What a try came to.

    Attributes
    ----------
    q:
        Configurations (n, nq).
    motion, scale:
        Of what, with the targets that it followed.
    softer:
        How many times less was asked of CoM and momentum.
    """

    q: Array
    motion: WholeMotion
    scale: MotionScale
    softer: int

    def notes(self, asked: float) -> list[str]:
        """Return what was given up, in words; ``asked``: the scale of time that was asked for."""
        found = list[str]()
        if self.scale.time != asked:
            found.append(
                f"{self.scale.time / asked:.2f} times as slow as asked for: joints of"
                f" {self.motion.tasks.robot.name} are no faster, or no stronger"
            )
        if self.softer > 0:
            less, least = SOFTER**self.softer, SOFTER ** (2 * self.softer)
            found.append(
                f"CoM and momentum weigh less, {less:g} and {least:g} times: limits and margins"
                " leave no more"
            )
        return found


def kept(
    problem: Problem, scale: MotionScale, weights: RetargetWeights, rounds: int, balance: bool,
    progress: Progress | None,
) -> Tried:  # fmt: skip
    """Return the first try that keeps what is hard, or the one that comes nearest to it."""
    more = {name: factor * getattr(weights, name) for name, factor in EAGER.items()}
    motion, axes = problem(scale, replace(weights, **more))
    best = solved(motion, axes, rounds, balance, progress, None)
    if best.speed <= NEARLY and (found := mended(motion, best.q, patient=False)).kept:
        return Tried(found.q, motion, scale, 0)
    softer, least = 0, math.inf
    q: Array | None = None
    for number in range(TRIES):
        motion, axes = problem(scale, weights)
        best = solved(motion, axes, rounds, balance, progress, q)
        last, too_fast = number == TRIES - 1, NEARLY < best.speed < TOO_SLOW
        found = mended(motion, best.q, patient=last)
        if found.lack < least or (last and found.kept):
            least, nearest = found.lack, Tried(found.q, motion, scale, softer)
        if found.kept and too_fast and not last:
            # Joints that are too slow may spoil a motion in its own time.
            too_fast = motion.looked_at(found.q).cost > SPOILED * max(best.cost, ENOUGH)
        if found.kept and not too_fast:
            return Tried(found.q, motion, scale, softer)
        if too_fast and (found.kept or number == 0):
            slower = min(best.speed, SLOWEST) * (1.0 + (number + 1) * MORE_SLOWLY)
            scale = replace(scale, time=scale.time * slower)
            q = best.q if best.violation < ASTRAY else None
            continue
        q = None
        softer += 1
        # With less asked of CoM and momentum it may, and with more time motors be strong enough.
        weights = replace(weights, com=SOFTER * weights.com, momentum=SOFTER**2 * weights.momentum)
        if max(found.speed, found.force) > 1.0:
            scale = replace(scale, time=SLOWER * scale.time)
    return nearest
