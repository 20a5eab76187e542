"""Identification of a recording's markers by name, and of its vertical axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from wbc.errors import listed
from wbc.human.landmarks import (
    Landmark,
    identifies_trunk,
    landmark,
    landmarks_of,
    missing_landmarks,
    without_prefix,
)
from wbc.human.markers import UPS, MarkerRecording
from wbc.motion.table import RecordingError
from wbc.validate import Array

# Cosine between the vector from feet to trunk and the vertical axis: at least the first for an axis
# to be found; below the second a given axis is not up, or the human lies.
UPRIGHT, LYING = 0.8, 0.5
MIRRORED = -0.2  # triple product of left, up and toe direction, unit vectors: 0.4 to 1 if not
# m, least distance of compared markers; relative difference of distances of the same human.
MIN_DISTANCE, MAX_DIFFERENCE = 0.05, 0.05
ELSEWHERE = 0.6  # m from all others of its segment, which are nearer each other: it is not there
BODY = ("pelvis", "trunk")
TOES, HEELS = ("toe", "metatarsal_1", "metatarsal_5"), ("heel", "ankle_lateral", "ankle_centre")


Markers = Mapping[str, Landmark]  # those that are fitted, by label


def identify_markers(
    recording: MarkerRecording, static: MarkerRecording | None
) -> tuple[Markers, tuple[str, ...]]:
    """Return the landmarks of the usable markers by label, and notes on the others.

    Markers that only the static trial has come last.
    """
    found, unknown = dict[str, Landmark](), list[str]()
    for one in (recording, *(() if static is None else (static,))):
        given = one.landmarks or (None,) * len(one.labels)
        by_name = landmarks_of(one.labels)
        for label, mark in zip(one.labels, given, strict=True):
            # Plug-in Gait writes its segments' axes as if they were markers: LCLA is no clavicle.
            axis = label[-1:] in "OALP" and all(label[:-1] + end in one.labels for end in "OALP")
            name = None if axis else by_name.get(label)
            if mark is None and name is None:
                unknown += [label] if label not in unknown else []
            elif label not in found:
                found[label] = mark if mark is not None else landmark(str(name))
    seen = np.isfinite(recording.positions).all(axis=2).any(axis=0)
    empty = [recording.labels[k] for k in np.flatnonzero(~seen) if recording.labels[k] in found]
    own = [label for label in recording.labels if label in found and label not in empty]
    far = [] if recording.landmarks else _elsewhere(recording, {one: found[one] for one in own})
    own = [label for label in own if label not in far]
    if not recording.landmarks:
        standing = [found[one].name for one in static.labels if one in found] if static else []
        missing = missing_landmarks([found[label].name for label in own], standing)
        if missing:
            raise RecordingError(
                f"markers that a fit needs are missing: {'; '.join(missing)}. Known by name:"
                f" {listed([f'{n} ({found[n].name})' for n in own], 20) or 'none'}; not known:"
                f" {listed(unknown, 20) or 'none'}. Rename them, as in Plug-in Gait",
                recording.source,
            )
    notes = list[str]()
    if unknown:
        notes.append(f"markers of unknown names left out: {listed(unknown, 8)}")
    if empty:
        notes.append(f"markers never seen: {listed(empty, 8)}")
    if far:
        whose = listed([f"{one} ({found[one].name})" for one in far], 8)
        notes.append(f"markers far from the others of their segments, left out: {whose}")
    rest = [label for label in found if label not in (*own, *empty, *far)]
    for part, both in (("pelvis", "hips"), ("trunk", "shoulders")):
        kinds = {found[n].name for n in own if found[n].segment == part}
        if 0 < len(kinds) < 3 and not recording.landmarks:
            pair = len({one.partition("_")[2] for one in kinds}) < len(kinds) == 2
            few = f"the {both} are" if pair else f"{listed(sorted(kinds), 3)} is"
            notes.append(f"of the {part} only {few} known: its tilt is less certain")
    segments = {found[n].segment for n in own}
    without = [s for s in ("head", "left_forearm", "right_forearm") if s not in segments]
    if not identifies_trunk(found[n] for n in own):
        notes.append(
            "no marker tells the lean of the trunk: it is held upright over the pelvis, head and"
            " arms are neutral; forces and CoP are less certain"
        )
    elif without:
        notes.append(f"no markers on {', '.join(without)}: held in their neutral posture")
    return {name: found[name] for name in (*own, *rest)}, tuple(notes)


def _elsewhere(recording: MarkerRecording, markers: Markers) -> list[str]:
    """Return markers far from all others of their segments, whose names must mean another one."""
    nearest = dict[str, float]()
    for label, mark in markers.items():
        # Those beside its joint are no farther from it, either: a fingertip is no toe.
        own = mark.segment
        others = [n for n, m in markers.items() if n != label and own in (m.segment, m.anchor)]
        apart = [_distance(recording, label, one) for one in others]
        nearest[label] = min(apart) if len(apart) > 1 else 0.0
    near = {markers[label].segment for label, way in nearest.items() if 0.0 < way < ELSEWHERE}
    return [n for n, way in nearest.items() if way > ELSEWHERE and markers[n].segment in near]


def rotate_z_up(
    recording: MarkerRecording, markers: Markers, up: str | None
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the recording with z up, and a note if the axis was found, or seems not to be up.

    Raises RecordingError: the vector from feet to trunk is along none of the axes; or left and
    right are exchanged.
    """
    axis = up if up is not None else recording.up
    high = _mean_position(recording, markers, lambda mark: mark.segment in BODY)
    low = _mean_position(recording, markers, lambda mark: mark.segment.endswith(("foot", "shank")))
    if np.isnan(high).all() or np.isnan(low).all():  # as in a static trial of some markers
        if axis is not None:
            return recording.upright(axis), ()
        raise RecordingError(
            "no marker on pelvis or trunk, or none on shanks and feet: say which axis is up (up)",
            recording.source,
        )
    _check_sides(recording, markers, high - low)
    up_vector = np.nanmedian(high, axis=0) - np.nanmedian(low, axis=0)
    up_vector /= np.linalg.norm(up_vector)
    k = int(np.abs(up_vector).argmax())
    if axis is not None:
        sign = -1.0 if axis.startswith("-") else 1.0
        lies = axis in UPS and sign * up_vector["xyz".index(axis[-1])] < LYING
        found = f"{'-' * bool(up_vector[k] < 0.0)}{'xyz'[k]}"
        note = (
            f"{axis} taken for up, as given, but the trunk is along {found} of the feet: does the"
            " human lie?"
        )
        return recording.upright(axis), (note,) if lies else ()
    if up_vector[k] < -UPRIGHT:
        raise RecordingError(
            f"the trunk is along -{'xyz'[k]} of the feet: its {'xyz'[k]} axis points down, as a"
            f" camera's (up='-{'xyz'[k]}', --up -{'xyz'[k]}), or the human sits or lies: say which"
            " axis is up (up)",
            recording.source,
        )
    if not up_vector[k] > UPRIGHT:
        raise RecordingError(
            f"the trunk is along ({', '.join(f'{v:.2f}' for v in up_vector)}) of the feet, along"
            " none of the axes x, y, z: say which one is up (up)",
            recording.source,
        )
    return recording.upright("xyz"[k]), (f"{'xyz'[k]} taken for up, by the trunk above the feet",)


def _check_sides(recording: MarkerRecording, markers: Markers, up: Array) -> None:
    """Raise RecordingError if left and right contradict the toes' direction; ``up``: (n, 3)."""

    def of_kinds(side: str, kinds: tuple[str, ...]) -> Array:
        names = [f"{side}_{kind}" for kind in kinds]
        return _mean_position(recording, markers, lambda mark: mark.name in names)

    def of_body(side: str) -> Array:
        return _mean_position(
            recording, markers, lambda mark: mark.segment in BODY and mark.name.startswith(side)
        )

    left = of_body("left_") - of_body("right_")
    feet = [of_kinds(side, TOES) - of_kinds(side, HEELS) for side in ("left", "right")]
    forward = feet[0] + feet[1]
    sizes = [np.linalg.norm(one, axis=1) for one in (left, up, forward)]
    with np.errstate(invalid="ignore", divide="ignore"):
        volume = (np.cross(left, up) * forward).sum(axis=1) / np.prod(sizes, axis=0)
    if np.isfinite(volume).any() and float(np.nanmedian(volume)) < MIRRORED:
        raise RecordingError(
            "by the direction of its toes its left side is on the right: its axes are left-handed,"
            " as Unity's, or its sides are exchanged; negate one axis, or rename the markers",
            recording.source,
        )


def _mean_position(
    recording: MarkerRecording, markers: Markers, which: Callable[[Landmark], bool]
) -> Array:
    """Return the mean position (n, 3) of the seen ones of some markers; NaN where none is."""
    places = recording.positions[:, recording.columns(n for n, m in markers.items() if which(m))]
    seen = np.asarray(np.isfinite(places).all(axis=2))[..., None]
    with np.errstate(invalid="ignore"):  # 0 / 0: not seen
        return np.asarray(np.where(seen, places, 0.0).sum(axis=1) / seen.sum(axis=1))


def with_labels_of(static: MarkerRecording, recording: MarkerRecording) -> MarkerRecording:
    """Return a static trial whose labels are the recording's, but for a subject's name or case."""
    of = {plain.lower(): label for label, plain in without_prefix(recording.labels).items()}
    plain = without_prefix(static.labels)
    labels = tuple(of.get(rest.lower(), rest) for rest in plain.values())
    return static if len(set(labels)) < len(labels) else replace(static, labels=labels)


def static_trial_notes(
    recording: MarkerRecording, static: MarkerRecording, markers: Markers
) -> tuple[str, ...]:
    """Return a note on a static trial that seems to be of another human than the recording.

    By distances between markers of one segment: of one human they differ by 1 to 2 % in the median.
    """
    shared = [name for name in markers if name in recording.labels and name in static.labels]
    ratios = list[float]()
    for pair in combinations(shared, 2):
        if markers[pair[0]].segment == markers[pair[1]].segment:
            standing, moving = _distance(static, *pair), _distance(recording, *pair)
            if min(standing, moving) > MIN_DISTANCE:
                ratios.append(standing / moving)
    if not ratios:
        return (
            "the static trial shares no two markers of a segment with the recording: it cannot be"
            " checked that it is the same human",
        )
    if np.median(np.abs(np.log(ratios))) < MAX_DIFFERENCE:
        return ()
    return (
        f"markers of the static trial are {np.median(ratios):.2f} times as far apart on their"
        " segments as the recording's, or elsewhere on them: is it the same human?",
    )


def _distance(recording: MarkerRecording, one: str, other: str) -> float:
    """Return the median distance of two markers [m], 0 if they are never seen together."""
    ends = [recording.positions[:, recording.labels.index(name)] for name in (one, other)]
    distance = np.linalg.norm(ends[1] - ends[0], axis=1)
    distance = distance[np.isfinite(distance)]
    return float(np.median(distance)) if distance.size else 0.0
