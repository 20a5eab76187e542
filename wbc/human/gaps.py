"""What a recording of markers lacks: gaps, swapped markers and ghosts; found, told and filled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from wbc.human.markers import MarkerRecording
from wbc.motion.dropouts import MISSING, Dropout, runs
from wbc.validate import Array

GHOST = 0.12  # m from where the fit has it, and
FARTHER = 6.0  # times its usual residual: what is farther is no longer that marker
# Swapped: both moved by this much [m] from one frame to the next, the other's place being nearer
# by this factor.
JUMP, CLOSER = 0.04, 0.4
SWAPPED, GHOSTS = "swapped markers", "ghost"
SHOWN = 0.5  # of the most markers seen at once: with fewer a human has not come yet, or has gone
# A leap: half of the markers move farther in one step than in those beside it, by at least so far
# [m], and by more than this acceleration [m/s^2] brings about, which no whole body has.
LEAP, SUDDEN = 0.05, 40.0
LEAPS = 4  # that are named


def while_shown(
    recording: MarkerRecording, names: tuple[str, ...]
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the recording from when its human comes until it goes, and a note if that is less.

    A human that no marker tells of would stand still there, and be taken for one that stands.
    """
    columns = [recording.labels.index(name) for name in names if name in recording.labels]
    count = np.isfinite(recording.positions[:, columns]).all(axis=2).sum(axis=1)
    shown = np.flatnonzero(count >= SHOWN * count.max())
    part = slice(shown[0], shown[-1] + 1)
    time = recording.time[part]
    if len(time) == len(recording.time):
        return recording, ()
    note = f"taken from {time[0]:.2f} to {time[-1]:.2f} s: else most markers are not seen"
    return replace(recording, time=time, positions=recording.positions[part]), (note,)


def without_leaps(
    recording: MarkerRecording, names: tuple[str, ...]
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the longest part of a recording in which its human does not leap, and a note.

    Many files of animation begin with one frame of another posture, mostly a T-pose elsewhere;
    others were joined. A low-pass across a leap makes forces of many times the weight of it.
    """
    columns = [recording.labels.index(name) for name in names if name in recording.labels]
    places, time = recording.positions[:, columns], recording.time
    moved = np.linalg.norm(np.diff(places, axis=0), axis=2)
    seen = np.isfinite(moved)
    enough = seen.sum(axis=1) >= SHOWN * seen.sum(axis=1).max(initial=1)
    far = np.zeros(len(moved))
    far[enough] = np.nanmedian(moved[enough], axis=1)
    beside = np.maximum(np.append(0.0, far[:-1]), np.append(far[1:], 0.0))
    step = 1.0 / recording.rate
    leaps = np.flatnonzero(far - beside > max(LEAP, SUDDEN * step**2)) + 1
    leaps = leaps[np.diff(time)[leaps - 1] < 1.5 * step]  # else nobody knows what was between
    if not len(leaps):
        return recording, ()
    ends = np.array((0, *leaps, len(time)))
    longest = int(np.diff(ends).argmax())
    part = slice(ends[longest], ends[longest + 1])
    told = ", ".join(f"{time[k]:.3f} s" for k in leaps[:LEAPS]) + (" ..." * (len(leaps) > LEAPS))
    note = (
        f"all of the body leaps at {told}, as from a T-pose: taken from {time[part.start]:.3f} to"
        f" {time[part.stop - 1]:.3f} s"
    )
    return replace(recording, time=time[part], positions=recording.positions[part]), (note,)


def filled_shortly(
    time: Array, positions: Array, labels: tuple[str, ...], longest: float
) -> tuple[Array, list[Dropout]]:
    """Return positions (n, m, 3) with gaps up to ``longest`` [s] interpolated, and which."""
    positions, found = positions.copy(), list[Dropout]()
    for k, label in enumerate(labels):
        lost = np.asarray(~np.isfinite(positions[:, k]).all(axis=1))
        if not lost.any() or lost.sum() > len(time) - 4:
            continue
        curve = PchipInterpolator(time[~lost], positions[~lost, k])
        for first, end in runs(lost):
            if first == 0 or end == len(time) or time[end] - time[first - 1] > longest:
                continue
            positions[first:end, k] = curve(time[first:end])
            span = float(time[first - 1]), float(time[end])
            found.append(Dropout(MISSING, *span, (label,), True))
    return positions, found


def filled_by_fit(
    time: Array, observed: Array, fitted: Array, labels: tuple[str, ...]
) -> tuple[Array, list[Dropout]]:
    """Return positions (n, m, 3) in which gaps follow the fit, and which.

    A marker that comes or goes would move the fit by its residual at once; so the fit's place with
    the residual carried across the gap, linearly, stands in for it. Markers that were never seen
    stay unseen.
    """
    observed, found = observed.copy(), list[Dropout]()
    for k, label in enumerate(labels):
        seen = np.asarray(np.isfinite(observed[:, k]).all(axis=1))
        if not seen.any() or seen.all():
            continue
        rest = observed[seen, k] - fitted[seen, k]
        carried = np.column_stack([np.interp(time, time[seen], part) for part in rest.T])
        observed[~seen, k] = (fitted[:, k] + carried)[~seen]
        for first, end in runs(~seen):
            span = float(time[max(first - 1, 0)]), float(time[min(end, len(time) - 1)])
            found.append(Dropout(MISSING, *span, (label,), True))
    return observed, found


def unswapped(
    time: Array, positions: Array, labels: tuple[str, ...], fixed: NDArray[np.bool_]
) -> tuple[Array, list[Dropout]]:
    """Return positions (n, m, 3) in which swapped labels are swapped back, and which.

    Two markers are swapped from a frame on if each goes on where the other was, and not where it
    was itself. Those with ``fixed`` labels (m,) cannot be: a skeleton's file says which is which.
    """
    positions, found = positions.copy(), list[Dropout]()
    since = dict[tuple[int, int], int]()
    for frame in range(1, len(time)):
        before, now = positions[frame - 1], positions[frame]
        own = np.linalg.norm(now - before, axis=1)
        jumped = np.flatnonzero((np.nan_to_num(own) > JUMP) & ~fixed).tolist()
        for number, a in enumerate(jumped):
            for b in jumped[number + 1 :]:
                crossed = np.linalg.norm(now[[a, b]] - before[[b, a]], axis=1)
                if not (crossed < CLOSER * own[[a, b]]).all():
                    continue
                positions[frame:, [a, b]] = positions[frame:, [b, a]]
                own[[a, b]] = crossed
                if (a, b) in since:
                    span = float(time[since.pop((a, b))]), float(time[frame])
                    found.append(Dropout(SWAPPED, *span, (labels[a], labels[b]), True))
                else:
                    since[(a, b)] = frame
    for (a, b), frame in since.items():
        span = float(time[frame]), float(time[-1])
        found.append(Dropout(SWAPPED, *span, (labels[a], labels[b]), True))
    return positions, found


def without_ghosts(
    time: Array, observed: Array, fitted: Array, labels: tuple[str, ...]
) -> tuple[Array, list[Dropout]]:
    """Return positions in which ghosts are NaN, and which.

    A ghost is farther from where the fit has the marker than 12 cm, and than six times its median
    residual.
    """
    observed, found = observed.copy(), list[Dropout]()
    off = np.linalg.norm(observed - fitted, axis=2)
    usual = np.array([np.median(c[np.isfinite(c)]) if np.isfinite(c).any() else 0.0 for c in off.T])
    far = np.nan_to_num(off) > np.maximum(GHOST, FARTHER * usual)
    observed[far] = np.nan
    for k, label in enumerate(labels):
        for first, end in runs(far[:, k]):
            span = float(time[first]), float(time[end - 1])
            found.append(Dropout(GHOSTS, *span, (label,), True))
    return observed, found
