"""A walk on a treadmill in the frame of its belt, where it is a walk on the ground.

The belt's frame moves at a constant velocity, so forces and accelerations are the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wbc.human.marker_identification import Markers
from wbc.human.markers import MarkerRecording
from wbc.validate import Array

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
    """Return the recording, with its plates, in axes that move at ``velocity`` (3,) [m/s]."""
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
