"""The way of a foot over edges: up before the first, over all of them, down behind the last."""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np

from wbc.errors import InvalidInputError, shown
from wbc.minimum_jerk import minimum_jerk, minimum_jerk_rates
from wbc.run.phase_support import Ground
from wbc.validate import Array, finite_array

# In parts of how high a foot is lifted: how far about the sole edges are looked for, and how high
# above an edge it is when it comes there.
AROUND, ABOVE = 0.35, 0.35
# What is higher than the foot by less than this part of that is no edge.
UNEVEN = 0.1
PLACES = 41  # of the way at which the ground is looked at
TIMES = np.linspace(0.0, 1.0, 201)  # parts of that in which a foot goes ahead
PROGRESS = minimum_jerk(TIMES)
# How far a foot is tipped, in parts of the slope of its way ahead, and at most [rad], and after
# which part of its time.
STEEPER, MOST_TIP, TIPPED = 1.3, 0.6, 0.35
# A foot goes ahead in this part of its time at least.
LEAST_AHEAD = 0.4
ROUNDS = 4  # by which waiting in the beginning and in the end are found: each shortens the way


class Crossing(NamedTuple):
    """A way that rises in half of its time and comes down in the other, by minimum-jerk curves.

    Its heel rises first: a foot that is lifted far while it is behind asks for more than an ankle
    bends, if it is level. A G1's ankle was at its limit on a step of 15 cm, its foot 10 cm too low.

    Attributes
    ----------
    start, top, end:
        Heights of the foot as it leaves the ground, half way, and as it lands [m].
    begins, ends:
        Parts of the time, in the beginning and in the end, in which the foot does not go ahead.
    tip:
        How far its toe is tipped down at most [rad].
    """

    start: float
    top: float
    end: float
    begins: float
    ends: float
    tip: float

    @classmethod
    def over(
        cls,
        start: Array,
        goal: Array,
        corners: Array,
        clearance: float,
        beside: float,
        ground: Ground | None = None,
    ) -> Self | None:
        """Return the way from ``start`` to ``goal``, both (x, y, yaw, z); None if no edge is there.

        Parameters
        ----------
        corners:
            (k, 2) of the sole, in its axes [m].
        clearance:
            How high above all that is below it the foot is lifted [m].
        beside:
            Height of the ground where the other foot stands [m].
        ground:
            If it is not known, the highest of start, goal and ``beside`` may be anywhere between.
        """
        first, last = float(start[3]), float(goal[3])
        parts, around = np.linspace(0.0, 1.0, PLACES), AROUND * clearance
        if ground is None:
            way = float(np.linalg.norm(goal[:2] - start[:2])) * parts
            between = (way > around) & (way < way[-1] - around)
            below = np.where(between, max(first, last, beside), np.where(parts < 0.5, first, last))
        else:
            wide = corners + around * np.sign(corners)
            outline = np.concatenate((wide, 0.5 * (wide + np.roll(wide, 1, axis=0))))
            x, y, yaw = (start[:3] + np.outer(parts, goal[:3] - start[:3])).T[:, :, None]
            c, s = np.cos(yaw), np.sin(yaw)
            dx, dy = outline.T
            points = np.stack((x + c * dx - s * dy, y + s * dx + c * dy), axis=-1)
            below = heights(ground, points.reshape(-1, 2)).reshape(PLACES, -1).max(axis=1)
        up, down = (below > height + UNEVEN * clearance for height in (first, last))
        if not (up.any() or down.any()):
            return None
        way, high = goal[:2] - start[:2], max(float(below.max()), first, last)
        yaw = float(start[2])
        ahead = math.cos(yaw) * way[0] + math.sin(yaw) * way[1]
        steep = (high - min(first, last)) * max(ahead, 0.0) / max(float(way @ way), 1e-9)
        half, lift = float(np.abs(corners[:, 0]).max()), high + clearance - first
        # The toe goes down sooner than the foot goes up, by this factor at first.
        sooner = (0.5 / TIPPED) ** 3
        tip = min(STEEPER * steep, MOST_TIP, lift / ((sooner - 1.0) * half))
        toe = half * math.sin(tip)  # how much lower it is than the middle
        top, wanted = high + clearance + toe, below + ABOVE * clearance + toe
        ahead = np.interp(parts, PROGRESS, TIMES)
        # From either end, in which part of all the time each edge is cleared.
        rising, sinking = (
            0.5 * np.interp(wanted, height + (top - height) * PROGRESS, TIMES)
            for height in (first, last)
        )
        begins = ends = 0.0
        for _ in range(ROUNDS):
            begins = _waiting(rising[up], ahead[up], ends)
            ends = _waiting(sinking[down], 1.0 - ahead[down], begins)
        too_long = max(1.0, (begins + ends) / (1.0 - LEAST_AHEAD))
        return cls(first, top, last, begins / too_long, ends / too_long, tip)

    def lifted(self, s: float, rate: float) -> tuple[float, float, float]:
        """Return height [m], its rate and acceleration at the part ``s`` of the time.

        ``rate`` is that of s [1/s], taken as constant.
        """
        low = self.start if s < 0.5 else self.end
        part, slope, curve = ((self.top - low) * one for one in _bump(s, rate, 0.5))
        return low + part, slope, curve

    def tipped(self, s: float, rate: float) -> tuple[float, float, float]:
        """Return how far the toe is tipped down [rad], its rate and acceleration, likewise."""
        part, slope, curve = (self.tip * one for one in _bump(s, rate, TIPPED))
        return part, slope, curve


def heights(ground: Ground, points: Array) -> Array:
    """Return the heights (k,) of ground that the user gave at points (k, 2) [m].

    Raises
    ------
    InvalidInputError
        No function, or it returns something else, or what is not finite.
    """
    if not callable(ground):
        raise InvalidInputError(
            "footsteps, ground: expected a function of points (k, 2) that returns heights (k,),"
            f" such as terrain.height, got {shown(ground)}"
        )
    return finite_array("footsteps, ground, at k points", ground(points), (len(points),))


def _bump(s: float, rate: float, top: float) -> tuple[float, float, float]:
    """Return a curve from 0 to 1 at s = ``top`` and to 0 at s = 1, with its rate and acceleration.

    Its curvature is zero at all three.
    """
    part, way = (s / top, 1.0 / top) if s < top else ((1.0 - s) / (1.0 - top), -1.0 / (1.0 - top))
    slope, curve = minimum_jerk_rates(part)
    return minimum_jerk(part), slope * way * rate, curve * (way * rate) ** 2


def _waiting(cleared: Array, ahead: Array, later: float) -> float:
    """Return how long not to go ahead at first, such that edges are cleared as they are reached.

    Parameters
    ----------
    cleared:
        (k,) parts of all the time after which the foot is above each edge.
    ahead:
        (k,) parts of the time of going ahead after which it is there.
    later:
        Part of all the time in which it does not go ahead, in the end.
    """
    lacking = cleared - (1.0 - later) * ahead
    return max(0.0, float(np.max(lacking / np.maximum(1.0 - ahead, 1e-9), initial=0.0)))
