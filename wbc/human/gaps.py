"""Repair of marker recordings: gaps, swapped markers, ghosts and jumps are found and told."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from wbc.errors import InvalidInputError, listed
from wbc.human.markers import MarkerRecording
from wbc.motion.dropouts import MISSING, Dropout, insert_rows, missing_frames, runs
from wbc.motion.recording import MIN_ROWS
from wbc.validate import Array, Bools

# A ghost is farther from the fit than the first [m] and than this factor times its usual residual.
GHOST_DISTANCE, GHOST_FACTOR = 0.12, 6.0
# Markers are swapped if both jump by the first [m] and are nearer to each other's place by this
# factor.
SWAP_JUMP, SWAP_RATIO = 0.04, 0.4
SWAPPED, GHOST = "swapped markers", "ghost"
MIN_SEEN = 0.5  # of the most markers seen at once: with fewer the human is not in view
# The body jumps if the markers' median step exceeds those before and after by this distance [m],
# and by more than this acceleration [m/s^2] allows, which no whole body has.
BODY_JUMP, MAX_ACCELERATION = 0.05, 40.0
NAMED_JUMPS = 4


def while_in_view(
    recording: MarkerRecording, names: Iterable[str]
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the recording while its human is in view, and a note if that is not all of it.

    Without markers the fit would keep still, and look like a human that stands.
    """
    count = np.isfinite(recording.positions[:, recording.columns(names)]).all(axis=2).sum(axis=1)
    seen = np.flatnonzero(count >= MIN_SEEN * count.max())
    first, end = seen[0], seen[-1] + 1
    if end - first == len(count):
        return recording, ()
    start, stop = recording.time[[first, end - 1]]
    note = f"taken from {start:.2f} to {stop:.2f} s: elsewhere most markers are not seen"
    return _part_of(recording, first, end, note), (note,)


def longest_without_jump(
    recording: MarkerRecording, names: Iterable[str]
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the longest part of a recording without a jump of the whole body, and a note.

    Many animation files begin with one frame of another posture, mostly a T-pose elsewhere; others
    are spliced. A low-pass across a jump yields forces of many times the weight.
    """
    recording, notes = _without_single_frames(recording, names)
    places, time = recording.positions[:, recording.columns(names)], recording.time
    distances = np.linalg.norm(np.diff(places, axis=0), axis=2)
    seen = np.isfinite(distances)
    enough = seen.sum(axis=1) >= MIN_SEEN * seen.sum(axis=1).max(initial=1)
    median = np.zeros(len(distances))
    median[enough] = np.nanmedian(distances[enough], axis=1)
    neighbours = np.maximum(np.append(0.0, median[:-1]), np.append(median[1:], 0.0))
    dt = 1.0 / recording.rate
    jumps = np.flatnonzero(median - neighbours > _largest_step(dt)) + 1
    jumps = jumps[np.diff(time)[jumps - 1] < 1.5 * dt]  # across missing frames it may have moved
    if not len(jumps):
        return recording, notes
    ends = np.array((0, *jumps, len(time)))
    longest = int(np.diff(ends).argmax())
    first, end = ends[longest : longest + 2]
    times = listed([f"{one:.3f} s" for one in time[jumps]], NAMED_JUMPS)
    note = (
        f"the whole body jumps at {times}, as from a T-pose: taken from {time[first]:.3f} to"
        f" {time[end - 1]:.3f} s"
    )
    return _part_of(recording, first, end, note), (*notes, note)


def with_missing_frames(recording: MarkerRecording) -> MarkerRecording:
    """Return a recording in whose missing frames, by its times, no marker is seen."""
    gaps = missing_frames(recording.time)
    if not gaps:
        return recording
    rows = recording.positions.reshape(len(recording.time), -1)
    time, rows = insert_rows(recording.time, rows, gaps)
    return replace(recording, time=time, positions=rows.reshape(len(time), -1, 3))


def _part_of(recording: MarkerRecording, first: int, end: int, why: str) -> MarkerRecording:
    count = len(recording.time)
    if end - first < MIN_ROWS:
        raise InvalidInputError(
            f"{recording.source}: {end - first} of {count} frames are left, and at least {MIN_ROWS}"
            f" are needed: {why}"
        )
    part = slice(first, end)
    return replace(recording, time=recording.time[part], positions=recording.positions[part])


def _largest_step(dt: float) -> float:
    """Return how far a whole body may move in ``dt`` [s] beyond its neighbouring steps [m]."""
    return max(BODY_JUMP, MAX_ACCELERATION * dt**2)


def _without_single_frames(
    recording: MarkerRecording, names: Iterable[str]
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the recording without frames in which the whole body is elsewhere, and a note."""
    places = recording.positions[:, recording.columns(names)]
    there, back, across = (
        np.linalg.norm(one, axis=2)
        for one in (places[1:-1] - places[:-2], places[2:] - places[1:-1], places[2:] - places[:-2])
    )
    away = np.minimum(there, back) - across > _largest_step(1.0 / recording.rate)
    seen = np.isfinite(there + back).sum(axis=1)
    single = np.flatnonzero((away.sum(axis=1) > 0.5 * seen) & (seen > 0)) + 1
    if not len(single):
        return recording, ()
    positions = recording.positions.copy()
    positions[single] = np.nan
    times = listed([f"{one:.3f} s" for one in recording.time[single]], NAMED_JUMPS)
    note = f"the whole body is elsewhere for one frame, at {times}: interpolated there"
    return replace(recording, positions=positions), (note,)


def interpolate_gaps(
    time: Array, positions: Array, labels: tuple[str, ...], longest: float
) -> tuple[Array, list[Dropout]]:
    """Interpolate gaps of positions (n, m, 3) up to ``longest`` [s]; return them and the gaps."""
    positions, found = positions.copy(), list[Dropout]()
    for k, label in enumerate(labels):
        missing = np.asarray(~np.isfinite(positions[:, k]).all(axis=1))
        if not missing.any() or missing.sum() > len(time) - 4:
            continue
        curve = PchipInterpolator(time[~missing], positions[~missing, k])
        for first, end in runs(missing):
            if first == 0 or end == len(time) or time[end] - time[first - 1] > longest:
                continue
            positions[first:end, k] = curve(time[first:end])
            found.append(_repaired(MISSING, time[first - 1], time[end], label))
    return positions, found


def gaps_of(time: Array, positions: Array, labels: tuple[str, ...]) -> list[Dropout]:
    """Return the gaps of the markers that are seen at some times, of positions (n, m, 3)."""
    found = list[Dropout]()
    seen: Bools = np.asarray(np.isfinite(positions).all(axis=2))
    for k in np.flatnonzero(seen.any(axis=0)).tolist():
        for first, end in runs(~seen[:, k]):
            before, after = time[max(first - 1, 0)], time[min(end, len(time) - 1)]
            found.append(_repaired(MISSING, before, after, labels[k]))
    return found


def fill_gaps_by_fit(time: Array, observed: Array, fitted: Array) -> Array:
    """Return positions (n, m, 3) whose gaps are filled by the fit.

    A marker that appears or disappears would move the fit by its residual at once, so the residual
    is interpolated linearly across the gap and added. Markers that are never seen stay NaN.
    """
    observed = observed.copy()
    for k in range(observed.shape[1]):
        seen = np.asarray(np.isfinite(observed[:, k]).all(axis=1))
        if not seen.any() or seen.all():
            continue
        residual = observed[seen, k] - fitted[seen, k]
        bridge = np.column_stack([np.interp(time, time[seen], part) for part in residual.T])
        observed[~seen, k] = (fitted[:, k] + bridge)[~seen]
    return observed


def swap_back(
    time: Array, positions: Array, labels: tuple[str, ...], fixed: Bools
) -> tuple[Array, list[Dropout]]:
    """Swap back swapped labels of positions (n, m, 3); return them and the swaps.

    Two markers are swapped from a frame on if each continues the other's track rather than its own.
    Markers with ``fixed`` labels (m,) are not: a skeleton's file identifies them.
    """
    positions, found = positions.copy(), list[Dropout]()
    since = dict[tuple[int, int], int]()
    for frame in range(1, len(time)):
        before, now = positions[frame - 1], positions[frame]
        own = np.linalg.norm(now - before, axis=1)
        jumped = np.flatnonzero((np.nan_to_num(own) > SWAP_JUMP) & ~fixed).tolist()
        for number, a in enumerate(jumped):
            for b in jumped[number + 1 :]:
                crossed = np.linalg.norm(now[[a, b]] - before[[b, a]], axis=1)
                if not (crossed < SWAP_RATIO * own[[a, b]]).all():
                    continue
                positions[frame:, [a, b]] = positions[frame:, [b, a]]
                own[[a, b]] = crossed
                if (a, b) in since:
                    begin = time[since.pop((a, b))]
                    found.append(_repaired(SWAPPED, begin, time[frame], labels[a], labels[b]))
                else:
                    since[(a, b)] = frame
    for (a, b), frame in since.items():
        found.append(_repaired(SWAPPED, time[frame], time[-1], labels[a], labels[b]))
    return positions, found


def remove_ghosts(
    time: Array, observed: Array, fitted: Array, labels: tuple[str, ...]
) -> tuple[Array, list[Dropout]]:
    """Set ghosts of positions (n, m, 3) to NaN; return them and the ghosts.

    A ghost is farther from the fit than 12 cm, and than six times the marker's median residual.
    """
    observed, found = observed.copy(), list[Dropout]()
    distance = np.linalg.norm(observed - fitted, axis=2)
    usual = np.array(
        [np.median(c[np.isfinite(c)]) if np.isfinite(c).any() else 0.0 for c in distance.T]
    )
    ghosts = np.nan_to_num(distance) > np.maximum(GHOST_DISTANCE, GHOST_FACTOR * usual)
    observed[ghosts] = np.nan
    for k, label in enumerate(labels):
        for first, end in runs(ghosts[:, k]):
            found.append(_repaired(GHOST, time[first], time[end - 1], label))
    return observed, found


def _repaired(kind: str, start: float, end: float, *labels: str) -> Dropout:
    return Dropout(kind, float(start), float(end), labels, True)
