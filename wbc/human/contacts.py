"""Detection of foot contacts by the motion alone: low and slow soles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wbc.motion.dropouts import runs
from wbc.motion.ground import sole_corners
from wbc.robot import Robot
from wbc.validate import Array, Bools

MAX_HEIGHT, MAX_SPEED = 0.035, 0.6  # m above the ground, m/s: of a sole's lowest corner in contact
SHORTEST = 0.06  # s: shorter contacts, and gaps in them, are noise
# Cutoff by the step rate: most of the ground's force is below the third harmonic (Antonsson and
# Mann 1985, J. Biomech. 18, 39-47); above it markers show more of skin than of bones.
HARMONICS = 2.4
SHORTEST_STEP, LONGEST_STEP = 0.2, 1.2  # s, where only two touchdowns tell
USUAL_CUTOFF, CUTOFF_RANGE = 6.0, (4.0, 12.0)  # Hz: without steps; least and largest with steps


def feet_down(robot: Robot, soles: dict[str, Array], time: Array, height: float) -> Bools:
    """Return which feet touch the ground (n, f), in the order of ``robot.feet``.

    ``soles``: placements of the sole frames (n, 4, 4), of a smooth motion.
    """
    corners = sole_corners(robot, soles)  # (n, f, k, 3)
    speed = np.linalg.norm(np.gradient(corners, time, axis=0), axis=3)
    lowest = corners[..., 2].argmin(axis=2)[..., None]
    low = np.take_along_axis(corners[..., 2], lowest, axis=2)[..., 0] - height < MAX_HEIGHT
    slow = np.take_along_axis(speed, lowest, axis=2)[..., 0] < MAX_SPEED
    down = low & slow
    for flags in down.T:
        for value in (False, True):  # short gaps first, then short contacts
            for first, end in runs(flags == value):
                short = time[end - 1] - time[first] < SHORTEST
                if short and first > 0 and end < len(time):
                    flags[first:end] = not value
    return np.asarray(down)


def nearest_rows(time: Array, at: Array) -> NDArray[np.intp]:
    """Return the indices into increasing times (n,) that are nearest to others (m,)."""
    return np.rint(np.interp(at, time, np.arange(len(time)))).astype(np.intp)


def cutoff_by_steps(down: Bools, time: Array) -> float:
    """Return the cutoff for a human's motion [Hz], by the median time between touchdowns.

    Two touchdowns, as in recordings of one stride, are a step if they are as far apart as steps
    are, and so are two times at which feet leave the ground.
    """
    up, was_down = ~down[1:], down[:-1]
    touchdowns = time[1:][(down[1:] & ~was_down).any(axis=1)]
    steps = np.diff(touchdowns)
    if len(steps) < 2:
        steps = np.concatenate((steps, np.diff(time[1:][(up & was_down).any(axis=1)])))
        steps = steps[(steps > SHORTEST_STEP) & (steps < LONGEST_STEP)]
    if not len(steps):
        return USUAL_CUTOFF
    rate = 1.0 / float(np.median(steps))
    return float(np.clip(HARMONICS * rate, *CUTOFF_RANGE))
