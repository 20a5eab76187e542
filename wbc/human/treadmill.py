"""A walk on a treadmill, seen from its belt: there it is a walk on the ground.

The belt's axes move evenly, so forces and accelerations are the same.
"""

from __future__ import annotations

import numpy as np

from wbc.human.landmarks import Landmark
from wbc.human.markers import ForcePlate, MarkerRecording
from wbc.validate import Array

SLOWEST = 0.3  # m/s: what feet that stand seem to move by on still ground is less
LOW = 0.3  # part of the frames, in which a foot is lowest, that is taken for standing
STAYS = 0.2  # of the belt's speed: a human on it moves by less on the whole
EVEN = 0.3  # of the belt's speed: feet on it do not differ by more
LEAST_FRAMES = 10


def belt_velocity(
    recording: MarkerRecording, names: tuple[str, ...], marks: tuple[Landmark, ...]
) -> Array:
    """Return how the ground moves (3,) [m/s], z up: 0, unless it is a belt.

    It is one where feet move evenly while they are low, and the pelvis stays where it is.
    """
    still = np.zeros(3)
    low = [_low_velocities(recording, names, marks, side) for side in ("left", "right")]
    pelvis = _mean_of(recording, names, marks, "pelvis")
    seen = np.flatnonzero(np.isfinite(pelvis).all(axis=1))
    velocities = np.concatenate(low)
    if len(velocities) < LEAST_FRAMES or len(seen) < LEAST_FRAMES:
        return still
    belt = np.append(np.median(velocities, axis=0), 0.0)
    speed = float(np.linalg.norm(belt))
    first, last = seen[0], seen[-1]
    way = (pelvis[last] - pelvis[first])[:2] / (recording.time[last] - recording.time[first])
    differing = float(np.median(np.linalg.norm(velocities - belt[:2], axis=1)))
    if speed < SLOWEST or np.linalg.norm(way) > STAYS * speed or differing > EVEN * speed:
        return still
    return belt


def from_the_belt(recording: MarkerRecording, velocity: Array) -> MarkerRecording:
    """Return the recording in axes that move at ``velocity`` (3,) [m/s], plates with it."""
    begin = recording.time[0]
    moved = recording.positions - (recording.time - begin)[:, None, None] * velocity
    plates = []
    for plate in recording.plates:
        way = -(plate.time - begin)[:, None] * velocity
        moment = plate.moment + np.cross(way, plate.force)
        plates.append(ForcePlate(plate.name, plate.time, plate.force, moment))
    return recording.moved(moved, tuple(plates))


def _mean_of(
    recording: MarkerRecording, names: tuple[str, ...], marks: tuple[Landmark, ...], segment: str
) -> Array:
    """Return the mean (n, 3) of a segment's markers; NaN where one of them is not seen."""
    where = [
        recording.labels.index(name)
        for name, mark in zip(names, marks, strict=True)
        if mark.segment == segment and name in recording.labels
    ]
    if not where:
        return np.full((len(recording.time), 3), np.nan)
    return np.asarray(recording.positions[:, where].mean(axis=1))


def _low_velocities(
    recording: MarkerRecording, names: tuple[str, ...], marks: tuple[Landmark, ...], side: str
) -> Array:
    """Return the horizontal velocities (k, 2) [m/s] of a foot in the frames where it is lowest."""
    at = _mean_of(recording, names, marks, f"{side}_foot")
    velocity = np.gradient(at, recording.time, axis=0)
    good = np.isfinite(velocity).all(axis=1)
    if good.sum() < LEAST_FRAMES:
        return np.zeros((0, 2))
    low = good & (at[:, 2] <= np.quantile(at[good, 2], LOW))
    return np.asarray(velocity[low, :2])
