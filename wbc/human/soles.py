"""The ground under a human's feet, from when they stand flat."""

from __future__ import annotations

import numpy as np

from wbc.human.body import ANKLE_HEIGHT, SEGMENT_NAMES, SIDES, HumanBody
from wbc.human.kinematics import Placed
from wbc.human.skeleton import FittedSole
from wbc.validate import Array

RESTING = 0.2  # m/s: an ankle slower than this, and
LEVEL = 0.012  # m: no higher than this above its lowest ones, is that of a foot that is flat
LOWEST = 0.1  # part of the frames that counts as the lowest
SAME_GROUND = 0.04  # m: nearer than this to 0 the ground is at 0
STEEPEST = 0.85  # cosine of the tilt of a foot that may stand flat
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
