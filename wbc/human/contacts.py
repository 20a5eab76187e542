"""When feet touch the ground by the motion alone, its height, and the shape of flat soles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wbc.human.body import ANKLE_HEIGHT, SEGMENT_NAMES, SIDES, HumanBody
from wbc.human.kinematics import SegmentFrames
from wbc.human.skeleton import FittedSole
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
# A foot stands flat if its ankle is slower than the first [m/s], and at most this high [m] above a
# low quantile of its heights.
MAX_ANKLE_SPEED, MAX_ANKLE_RISE, LOW_QUANTILE = 0.2, 0.012, 0.1
GROUND_TOLERANCE = 0.04  # m: a ground this near to 0 is at 0
MIN_UPRIGHTNESS = 0.85  # cosine of the tilt of a foot that may stand flat
# Feet at rest for so long [s], with heights so far apart [m], do not stand on level ground.
MIN_REST, MAX_LEVEL_DIFFERENCE = 0.1, 0.08
SAME_TILT = 0.97  # cosine between the axes of a flat foot and of one at rest elsewhere
ANKLE_HEIGHTS = (0.3, 2.5)  # of a flat foot, by the usual one


def feet_down(robot: Robot, soles: dict[str, Array], time: Array, height: float) -> Bools:
    """Return which feet touch the ground (n, f), in the order of ``robot.feet``.

    ``soles``: placements of the sole frames (n, 4, 4), of a smooth motion.
    """
    corners = sole_corners(robot, soles)  # (n, f, k, 3)
    speeds = np.linalg.norm(np.gradient(corners, time, axis=0), axis=3)
    lowest = corners[..., 2].argmin(axis=2)[..., None]
    above = np.take_along_axis(corners[..., 2], lowest, axis=2)[..., 0] - height
    speed = np.take_along_axis(speeds, lowest, axis=2)[..., 0]
    down = (above < MAX_HEIGHT) & (speed < MAX_SPEED)
    # Of a recording that drifts the ground rises by some cm: a level foot that rests there, while
    # no other one is down, stands, since in the air none rests.
    level = np.stack([soles[foot][:, 2, 2] for foot in robot.feet], axis=1) > MIN_UPRIGHTNESS
    resting = (above < MAX_LEVEL_DIFFERENCE) & (speed < MAX_ANKLE_SPEED) & level
    carried = np.asarray(down.any(axis=1))
    for flags, rests in zip(down.T, resting.T, strict=True):
        for first, end in runs(rests):
            if time[end - 1] - time[first] > MIN_REST and not carried[first:end].all():
                flags[first:end] = True
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


def ground_and_soles(
    frames: SegmentFrames, time: Array, body: HumanBody, height: float | None
) -> tuple[float, dict[str, FittedSole], tuple[str, ...]]:
    """Return the ground's height [m], the soles by side, and notes.

    ``height``: of the ground [m]; None: 0, unless the feet contradict it.
    """
    usual = ANKLE_HEIGHT * body.scale
    flat = {side: _flat(frames, time, side) for side in SIDES}
    ankles = [frames.origin[flat[side], _foot(side), 2] for side in SIDES if flat[side].any()]
    notes = list[str]()
    if height is None:
        height = 0.0
        if ankles:
            guess = float(min(np.median(one) for one in ankles)) - usual
            if abs(guess) > GROUND_TOLERANCE:
                height = guess
                notes.append(f"ground taken at {1e3 * guess:.0f} mm, from where the feet stand")
    levels = [one for side in SIDES for one in _levels(frames, time, side, flat[side])]
    if levels and np.ptp(levels) > MAX_LEVEL_DIFFERENCE:
        low, high = (1e3 * (end(levels) - usual) for end in (min, max))
        what = f"feet stand at heights of {low:.0f} to {high:.0f} mm"
        notes.append(f"{what}: the ground is taken at {1e3 * height:.0f} mm only")
    soles = dict[str, FittedSole]()
    for side in SIDES:
        standing = np.flatnonzero(flat[side])
        if not len(standing):
            notes.append(f"the {side} foot never stands flat: its sole has usual dimensions")
            continue
        R = frames.rotation[standing, _foot(side)]
        above = float(np.median(frames.origin[standing, _foot(side), 2])) - height
        if not ANKLE_HEIGHTS[0] * usual < above < ANKLE_HEIGHTS[1] * usual:
            what = f"the {side} ankle stands {1e3 * above:.0f} mm above the ground"
            notes.append(f"{what}, which no sole does: a usual one is taken; check the ground")
            continue
        up = np.median(R[:, 2], axis=0)
        up /= np.linalg.norm(up)
        if up[2] < MIN_UPRIGHTNESS:
            what = f"the {side} foot is tilted by {np.degrees(np.arccos(up[2])):.0f} degrees"
            notes.append(f"{what} where it seems to stand: its sole has usual dimensions")
            continue
        forward = np.array((1.0, 0.0, 0.0)) - up[0] * up
        forward /= np.linalg.norm(forward)
        soles[side] = FittedSole(above, np.column_stack((forward, np.cross(up, forward), up)))
    return height, soles, tuple(notes)


def _foot(side: str) -> int:
    return SEGMENT_NAMES.index(f"{side}_foot")


def _flat(frames: SegmentFrames, time: Array, side: str) -> Array:
    """Return in which frames a foot stands flat (n,), bool."""
    at = frames.origin[:, _foot(side)]
    slow = np.linalg.norm(np.gradient(at, time, axis=0), axis=1) < MAX_ANKLE_SPEED
    if not slow.any():
        return slow
    lowest = float(np.quantile(at[slow, 2], LOW_QUANTILE))
    return np.asarray(slow & (np.abs(at[:, 2] - lowest) < MAX_ANKLE_RISE))


def _levels(frames: SegmentFrames, time: Array, side: str, flat: Array) -> list[float]:
    """Return the ankle's heights [m] in each interval in which a foot is at rest and flat."""
    at, up = frames.origin[:, _foot(side)], frames.rotation[:, _foot(side), 2]
    if not flat.any():
        return []
    resting = np.linalg.norm(np.gradient(at, time, axis=0), axis=1) < MAX_ANKLE_SPEED
    resting &= up @ np.median(up[flat], axis=0) > SAME_TILT
    return [
        float(np.median(at[first:end, 2]))
        for first, end in runs(resting)
        if time[end - 1] - time[first] > MIN_REST
    ]
