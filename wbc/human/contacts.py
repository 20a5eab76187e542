"""When feet touch the ground by the motion alone, its height, flat soles, and walks on belts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wbc.human.body import ANKLE_HEIGHT, SEGMENT_NAMES, SIDES, HumanBody
from wbc.human.kinematics import SegmentFrames
from wbc.human.marker_identification import Markers
from wbc.human.markers import MarkerRecording
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


MIN_BELT_SPEED = 0.3  # m/s: feet that stand on the ground seem to move by less
STANCE_QUANTILE = 0.3  # of the heights of a foot: lower frames are taken for its stance
MAX_DRIFT = 0.2  # mean speed of a human on a belt, by the belt's
MAX_DEVIATION = 0.3  # median deviation of the feet's velocities on a belt, by the belt's speed
MIN_FRAMES = 10


def belt_velocity(recording: MarkerRecording, markers: Markers) -> Array:
    """Return the velocity (3,) of the ground [m/s], z up: 0, unless it is a belt.

    On a belt low feet move at a constant velocity, and the pelvis stays in place.
    """
    at_rest = np.zeros(3)
    low = [_low_velocities(recording, markers, side) for side in ("left", "right")]
    pelvis = _mean_of(recording, markers, "pelvis")
    seen = np.flatnonzero(np.isfinite(pelvis).all(axis=1))
    velocities = np.concatenate(low)
    if len(velocities) < MIN_FRAMES or len(seen) < MIN_FRAMES:
        return at_rest
    belt = np.append(np.median(velocities, axis=0), 0.0)
    speed = float(np.linalg.norm(belt))
    first, last = seen[0], seen[-1]
    drift = (pelvis[last] - pelvis[first])[:2] / (recording.time[last] - recording.time[first])
    deviation = float(np.median(np.linalg.norm(velocities - belt[:2], axis=1)))
    moves = np.linalg.norm(drift) > MAX_DRIFT * speed
    if speed < MIN_BELT_SPEED or moves or deviation > MAX_DEVIATION * speed:
        return at_rest
    return belt


def in_belt_frame(recording: MarkerRecording, velocity: Array) -> MarkerRecording:
    """Return the recording, with its plates, in axes that move at ``velocity`` (3,) [m/s].

    There a walk on a treadmill is one on the ground; forces and accelerations are the same.
    """
    start = recording.time[0]
    moved = recording.positions - (recording.time - start)[:, None, None] * velocity
    plates = []
    for plate in recording.plates:
        shift = -(plate.time - start)[:, None] * velocity
        moment = plate.moment + np.cross(shift, plate.force)
        plates.append(replace(plate, moment=moment, corners=None))  # these would move
    return replace(recording, positions=moved, plates=tuple(plates))


def _mean_of(recording: MarkerRecording, markers: Markers, segment: str) -> Array:
    """Return the mean position (n, 3) of a segment's markers; NaN where one is not seen."""
    where = recording.columns(name for name, m in markers.items() if m.segment == segment)
    if not where:
        return np.full((len(recording.time), 3), np.nan)
    return np.asarray(recording.positions[:, where].mean(axis=1))


def _low_velocities(recording: MarkerRecording, markers: Markers, side: str) -> Array:
    """Return the horizontal velocities (k, 2) [m/s] of a foot where it is lowest."""
    at = _mean_of(recording, markers, f"{side}_foot")
    velocity = np.gradient(at, recording.time, axis=0)
    good = np.isfinite(velocity).all(axis=1)
    if good.sum() < MIN_FRAMES:
        return np.zeros((0, 2))
    low = good & (at[:, 2] <= np.quantile(at[good, 2], STANCE_QUANTILE))
    return np.asarray(velocity[low, :2])
