"""The ground under a human's feet, from when they stand flat."""

from __future__ import annotations

import numpy as np

from wbc.human.body import ANKLE_HEIGHT, SEGMENT_NAMES, SIDES, HumanBody
from wbc.human.kinematics import Placed
from wbc.human.skeleton import FittedSole
from wbc.motion.dropouts import runs
from wbc.validate import Array

RESTING = 0.2  # m/s: an ankle slower than this, and
LEVEL = 0.012  # m: no higher than this above its lowest ones, is that of a foot that is flat
LOWEST = 0.1  # part of the frames that counts as the lowest
SAME_GROUND = 0.04  # m: nearer than this to 0 the ground is at 0
STEEPEST = 0.85  # cosine of the tilt of a foot that may stand flat
STANDS, APART = 0.1, 0.08  # s, m: feet still for so long so far apart in height are on no level
SAME_TILT = 0.97  # cosine between the tilts of a foot that is flat and one that stands elsewhere
HEIGHTS = (0.3, 2.5)  # of the usual height of an ankle: what else is no flat foot


def ground_and_soles(
    placed: Placed, time: Array, body: HumanBody, height: float | None
) -> tuple[float, dict[str, FittedSole], tuple[str, ...]]:
    """Return the ground's height [m], the soles by side, and notes.

    Parameters
    ----------
    height:
        Of the ground [m]; None: 0, unless the feet say that it cannot be.
    """
    usual = ANKLE_HEIGHT * body.scale
    flat = {side: _flat(placed, time, side) for side in SIDES}
    ankles = [placed.origin[flat[side], _foot(side), 2] for side in SIDES if flat[side].any()]
    notes = list[str]()
    if height is None:
        height = 0.0
        if ankles:
            guess = float(min(np.median(one) for one in ankles)) - usual
            if abs(guess) > SAME_GROUND:
                height = guess
                notes.append(f"ground taken at {1e3 * guess:.0f} mm, from where the feet stand")
    levels = [one for side in SIDES for one in _levels(placed, time, side, flat[side])]
    if levels and np.ptp(levels) > APART:
        low, high = (1e3 * (end(levels) - usual) for end in (min, max))
        what = f"feet stand at heights of {low:.0f} to {high:.0f} mm"
        notes.append(f"{what}: only what is at {1e3 * height:.0f} mm is taken for ground")
    soles = dict[str, FittedSole]()
    for side in SIDES:
        frames = np.flatnonzero(flat[side])
        if not len(frames):
            notes.append(f"the {side} foot never stands flat: its sole is a usual one")
            continue
        R = placed.rotation[frames, _foot(side)]
        above = float(np.median(placed.origin[frames, _foot(side), 2])) - height
        if not HEIGHTS[0] * usual < above < HEIGHTS[1] * usual:
            what = f"the {side} ankle stands {1e3 * above:.0f} mm above the ground"
            notes.append(f"{what}: no sole is so thick, a usual one is taken; look at the ground")
            continue
        up = np.median(R[:, 2], axis=0)
        up /= np.linalg.norm(up)
        if up[2] < STEEPEST:
            what = f"the {side} foot is tilted by {np.degrees(np.arccos(up[2])):.0f} degrees"
            notes.append(f"{what} where it seems to stand: its sole is a usual one")
            continue
        forward = np.array((1.0, 0.0, 0.0)) - up[0] * up
        forward /= np.linalg.norm(forward)
        soles[side] = FittedSole(above, np.column_stack((forward, np.cross(up, forward), up)))
    return height, soles, tuple(notes)


def _foot(side: str) -> int:
    return SEGMENT_NAMES.index(f"{side}_foot")


def _flat(placed: Placed, time: Array, side: str) -> Array:
    """Return in which frames a foot is taken to stand flat (n,), bool."""
    at = placed.origin[:, _foot(side)]
    slow = np.linalg.norm(np.gradient(at, time, axis=0), axis=1) < RESTING
    if not slow.any():
        return slow
    lowest = float(np.quantile(at[slow, 2], LOWEST))
    return np.asarray(slow & (np.abs(at[:, 2] - lowest) < LEVEL))


def _levels(placed: Placed, time: Array, side: str, flat: Array) -> list[float]:
    """Return the ankle's heights [m] in the spans in which a foot is still, tilted as flat ones."""
    at, up = placed.origin[:, _foot(side)], placed.rotation[:, _foot(side), 2]
    if not flat.any():
        return []
    still = np.linalg.norm(np.gradient(at, time, axis=0), axis=1) < RESTING
    still &= up @ np.median(up[flat], axis=0) > SAME_TILT
    return [
        float(np.median(at[first:end, 2]))
        for first, end in runs(still)
        if time[end - 1] - time[first] > STANDS
    ]
