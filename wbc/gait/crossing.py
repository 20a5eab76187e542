"""The path of a swing foot over edges: up before the first, down behind the last."""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np

from wbc.errors import InvalidInputError, shown
from wbc.minimum_jerk import minimum_jerk
from wbc.native import lib
from wbc.run.phase_support import Ground
from wbc.validate import Array, finite_array

# As ratios of the swing clearance: how far around the sole edges are searched for, and how high
# above an edge the foot is when it reaches it.
SEARCH_MARGIN, EDGE_MARGIN = 0.35, 0.35
# Ground that is higher than the foot by less than this ratio of the clearance is no edge.
MIN_EDGE = 0.1
SAMPLES = 41  # points of the path at which the ground is evaluated
TIMES = np.linspace(0.0, 1.0, 201)  # normalised time of the horizontal motion
PROGRESS = minimum_jerk(TIMES)
# Pitch of the foot: as a ratio of the path's slope, and its maximum [rad].
PITCH_RATIO, MAX_PITCH = 1.3, 0.6
# The horizontal motion takes at least this part of the swing time.
MIN_ADVANCE = 0.4
ITERATIONS = 4  # for the dwells at both ends: each shortens the time that the other has


class Crossing(NamedTuple):
    """A path that rises in half of the swing time and descends in the other, minimum jerk both.

    The heel rises first: a level foot that is lifted far while it is behind exceeds the ankle's
    range. A G1's ankle was at its limit on a step of 15 cm, and its foot 10 cm too low.

    ``top``: height of the foot half way [m].
    ``begins``, ``ends``: parts of the swing time, at its beginning and end, without horizontal
    motion.
    ``tip``: largest pitch of the foot, toe down [rad].
    """

    top: float
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
        """Return the path from ``start`` to ``goal``, both (x, y, yaw, z); None without an edge.

        ``corners``: (k, 2) of the sole, in its axes [m].
        ``clearance``: how high the foot is lifted above everything below its path [m].
        ``beside``: height of the ground below the stance foot [m].
        ``ground``: if unknown, the highest of start, goal and ``beside`` may be anywhere between.
        """
        first, last = float(start[3]), float(goal[3])
        parts, margin = np.linspace(0.0, 1.0, SAMPLES), SEARCH_MARGIN * clearance
        if ground is None:
            path = float(np.linalg.norm(goal[:2] - start[:2])) * parts
            between = (path > margin) & (path < path[-1] - margin)
            terrain = np.where(
                between, max(first, last, beside), np.where(parts < 0.5, first, last)
            )
        else:
            inflated = corners + margin * np.sign(corners)
            outline = np.concatenate((inflated, 0.5 * (inflated + np.roll(inflated, 1, axis=0))))
            turn = math.remainder(float(goal[2] - start[2]), math.tau)
            way = np.array((*(goal[:2] - start[:2]), turn))
            x, y, yaw = (start[:3] + np.outer(parts, way)).T[:, :, None]
            c, s = np.cos(yaw), np.sin(yaw)
            dx, dy = outline.T
            points = np.stack((x + c * dx - s * dy, y + s * dx + c * dy), axis=-1)
            terrain = heights(ground, points.reshape(-1, 2)).reshape(SAMPLES, -1).max(axis=1)
        rises, falls = (terrain > height + MIN_EDGE * clearance for height in (first, last))
        if not (rises.any() or falls.any()):
            return None
        path, peak = goal[:2] - start[:2], max(float(terrain.max()), first, last)
        yaw = float(start[2])
        ahead = math.cos(yaw) * path[0] + math.sin(yaw) * path[1]
        slope = (peak - min(first, last)) * max(ahead, 0.0) / max(float(path @ path), 1e-9)
        half, lift = float(np.abs(corners[:, 0]).max()), peak + clearance - first
        # The pitch starts faster than the height, by this factor.
        lead = (0.5 / lib.wbc_pitch_peak) ** 3
        tip = min(PITCH_RATIO * slope, MAX_PITCH, lift / ((lead - 1.0) * half))
        drop = half * math.sin(tip)  # of the toe below the middle of the sole
        top, wanted = peak + clearance + drop, terrain + EDGE_MARGIN * clearance + drop
        ahead = np.interp(parts, PROGRESS, TIMES)
        # Normalised time, from either end, after which the foot is above each edge.
        rising, lowering = (
            0.5 * np.interp(wanted, height + (top - height) * PROGRESS, TIMES)
            for height in (first, last)
        )
        begins = ends = 0.0
        for _ in range(ITERATIONS):
            begins = _dwell(rising[rises], ahead[rises], ends)
            ends = _dwell(lowering[falls], 1.0 - ahead[falls], begins)
        excess = max(1.0, (begins + ends) / (1.0 - MIN_ADVANCE))
        return cls(top, begins / excess, ends / excess, tip)


def heights(ground: Ground, points: Array) -> Array:
    """Return the heights (k,) of the user's ground at points (k, 2) [m].

    Raises InvalidInputError: not a function, or its result is not finite or of another shape.
    """
    if not callable(ground):
        raise InvalidInputError(
            "footsteps, ground: expected a function of points (k, 2) that returns heights (k,),"
            f" such as terrain.height, got {shown(ground)}"
        )
    return finite_array("footsteps, ground, at k points", ground(points), (len(points),))


def _dwell(cleared: Array, ahead: Array, later: float) -> float:
    """Return the dwell at one end that clears all edges before they are reached.

    ``cleared``: (k,) normalised times after which the foot is above each edge.
    ``ahead``: (k,) times, in parts of the horizontal motion, at which it reaches them.
    ``later``: dwell at the other end.
    """
    missing = cleared - (1.0 - later) * ahead
    return max(0.0, float(np.max(missing / np.maximum(1.0 - ahead, 1e-9), initial=0.0)))
