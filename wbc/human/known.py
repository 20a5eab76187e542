"""Which markers of a recording are known, and which of its axes points up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from wbc.errors import listed
from wbc.human.landmarks import Landmark, lacking, landmark, landmarks_of, tells_trunk
from wbc.human.markers import UPS, MarkerRecording
from wbc.motion.table import RecordingError
from wbc.validate import Array

UPRIGHT = 0.8  # cosine between the way from feet to trunk and the axis that is taken for up
LYING = 0.5  # the same: with less the axis that was said is not up, or the human lies
MIRRORED = -0.2  # of the volume that left, up and the way of the toes span, which is 0.4 to 1
NEAR, UNLIKE = 0.05, 0.05  # m between markers, and how far these may be apart in two trials of one
TOES, HEELS = ("toe", "metatarsal_1", "metatarsal_5"), ("heel", "ankle_lateral", "ankle_centre")


def known_markers(
    recording: MarkerRecording, static: MarkerRecording | None
) -> tuple[tuple[str, ...], tuple[Landmark, ...], tuple[str, ...]]:
    """Return labels and landmarks of the markers that can be used, and notes on the others.

    Those of the recording come first; behind them those that only the static trial has.

    Raises
    ------
    RecordingError
        A fit cannot do without what is not there.
    """
    found, unknown = dict[str, Landmark](), list[str]()
    for one in (recording, *(() if static is None else (static,))):
        given = one.landmarks or (None,) * len(one.labels)
        meant = landmarks_of(one.labels)
        for label, mark in zip(one.labels, given, strict=True):
            # Plug-in Gait writes its segments' axes as if they were markers: LCLA is no clavicle.
            axis = label[-1:] in "OALP" and all(label[:-1] + end in one.labels for end in "OALP")
            name = None if axis else meant.get(label)
            if mark is None and name is None:
                unknown += [label] if label not in unknown else []
            elif label not in found:
                found[label] = mark if mark is not None else landmark(str(name))
    seen = np.isfinite(recording.positions).reshape(len(recording.time), -1, 3)
    empty = [
        label
        for k, label in enumerate(recording.labels)
        if label in found and not seen[:, k].all(axis=1).any()
    ]
    own = [label for label in recording.labels if label in found and label not in empty]
    if not recording.landmarks:
        still = [found[one].name for one in static.labels if one in found] if static else []
        wanted = lacking([found[label].name for label in own], still)
        if wanted:
            raise RecordingError(
                f"markers that a human needs are not there: {'; '.join(wanted)}. Known by name:"
                f" {listed([f'{n} ({found[n].name})' for n in own], 20) or 'none'}; not known:"
                f" {listed(unknown, 20) or 'none'}. Rename them, as in Plug-in Gait",
                recording.source,
            )
    notes = list[str]()
    if unknown:
        notes.append(f"markers of no known place left out: {listed(unknown, 8)}")
    if empty:
        notes.append(f"markers never seen: {listed(empty, 8)}")
    rest = [label for label in found if label not in own and label not in empty]
    names = (*own, *rest)
    for part, both in (("pelvis", "hips"), ("trunk", "shoulders")):
        kinds = {found[n].name for n in own if found[n].segment == part}
        if 0 < len(kinds) < 3 and not recording.landmarks:
            pair = len({one.partition("_")[2] for one in kinds}) < len(kinds) == 2
            few = f"the {both} are" if pair else f"{listed(sorted(kinds), 3)} is"
            notes.append(f"of the {part} only {few} known: how it tilts is less certain")
    arms = {found[n].segment for n in own}
    without = [s for s in ("head", "left_forearm", "right_forearm") if s not in arms]
    if not tells_trunk(found[n] for n in own):
        notes.append(
            "no marker tells how the trunk leans: it is held upright over the pelvis, head and arms"
            " as they usually are; forces and CoP are less certain"
        )
    elif without:
        notes.append(f"no markers on {', '.join(without)}: held as they usually are")
    return names, tuple(found[name] for name in names), tuple(notes)


def upright(
    recording: MarkerRecording, names: tuple[str, ...], marks: tuple[Landmark, ...], up: str | None
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the recording with z up, and a note if that axis was found, or is not the one said.

    Raises
    ------
    RecordingError
        From feet to trunk leads along none of the axes; or left is right of where toes point.
    """
    axis = up if up is not None else recording.up
    high = _middle(recording, names, marks, lambda mark: mark.segment in ("trunk", "pelvis"))
    low = _middle(recording, names, marks, lambda mark: mark.segment.endswith(("foot", "shank")))
    _check_sides(recording, names, marks, high - low)
    way = np.nanmedian(high, axis=0) - np.nanmedian(low, axis=0)
    way /= np.linalg.norm(way)
    k = int(np.abs(way).argmax())
    if axis is not None:
        lies = axis in UPS and way["xyz".index(axis)] < LYING
        leads = f"{'-' * bool(way[k] < 0.0)}{'xyz'[k]}"
        note = (
            f"{axis} taken for up, as was said, but from feet to trunk leads {leads}: does it lie?"
        )
        return recording.upright(axis), (note,) if lies else ()
    if way[k] < -UPRIGHT:
        raise RecordingError(
            f"from feet to trunk leads -{'xyz'[k]}: its {'xyz'[k]} axis points down, as a camera's"
            " (negate two axes), or the human sits or lies: say which one points up (up)",
            recording.source,
        )
    if not way[k] > UPRIGHT:
        raise RecordingError(
            f"from feet to trunk leads ({way[0]:.2f}, {way[1]:.2f}, {way[2]:.2f}), along none of"
            " the axes x, y, z: say which one points up (up)",
            recording.source,
        )
    return recording.upright("xyz"[k]), (f"{'xyz'[k]} taken for up, from feet to trunk",)


def _check_sides(
    recording: MarkerRecording, names: tuple[str, ...], marks: tuple[Landmark, ...], up: Array
) -> None:
    """Raise RecordingError where left is on the right of where toes point; ``up``: (n, 3)."""

    def middle(side: str, segments: Sequence[str] = (), kinds: Sequence[str] = ()) -> Array:
        return _middle(
            recording,
            names,
            marks,
            lambda mark: (
                mark.name.startswith(side)
                and (mark.segment in segments or mark.name.removeprefix(side) in kinds)
            ),
        )

    body = ("pelvis", "trunk")
    left = middle("left_", body) - middle("right_", body)
    feet = [middle(s, (), TOES) - middle(s, (), HEELS) for s in ("left_", "right_")]
    forward = feet[0] + feet[1]
    sizes = [np.linalg.norm(one, axis=1) for one in (left, up, forward)]
    with np.errstate(invalid="ignore", divide="ignore"):
        volume = (np.cross(left, up) * forward).sum(axis=1) / np.prod(sizes, axis=0)
    if np.isfinite(volume).any() and float(np.nanmedian(volume)) < MIRRORED:
        raise RecordingError(
            "its left side is on the right of where its toes point: its axes are left-handed, as"
            " Unity's, or its sides are exchanged; negate one axis, or rename the markers",
            recording.source,
        )


def _middle(
    recording: MarkerRecording,
    names: tuple[str, ...],
    marks: tuple[Landmark, ...],
    which: Callable[[Landmark], bool],
) -> Array:
    """Return the mean (n, 3) of those of some markers that are seen; NaN where none is."""
    columns = [
        recording.labels.index(name)
        for name, mark in zip(names, marks, strict=True)
        if name in recording.labels and which(mark)
    ]
    places = recording.positions[:, columns]
    seen = np.asarray(np.isfinite(places).all(axis=2))[..., None]
    with np.errstate(invalid="ignore"):  # 0 / 0: not seen
        return np.asarray(np.where(seen, places, 0.0).sum(axis=1) / seen.sum(axis=1))


def other_human(
    recording: MarkerRecording,
    static: MarkerRecording,
    names: Sequence[str],
    marks: Sequence[Landmark],
) -> tuple[str, ...]:
    """Return a note on a static trial whose human seems to be another one than the recording's.

    By distances between markers of one segment: of one human they differ by 1 to 2 % in the median.
    """
    segments = {
        name: mark.segment
        for name, mark in zip(names, marks, strict=True)
        if name in recording.labels and name in static.labels
    }
    ratios = list[float]()
    for pair in combinations(segments, 2):
        if segments[pair[0]] == segments[pair[1]]:
            still, moved = _distance(static, *pair), _distance(recording, *pair)
            if min(still, moved) > NEAR:
                ratios.append(still / moved)
    if not ratios:
        return (
            "the static trial shares no two markers of a segment with the recording: whether it is"
            " the same human cannot be told",
        )
    if np.median(np.abs(np.log(ratios))) < UNLIKE:
        return ()
    return (
        f"markers of the static trial are {np.median(ratios):.2f} times as far apart on their"
        " segments as the recording's, or elsewhere on them: is it the same human?",
    )


def _distance(recording: MarkerRecording, one: str, other: str) -> float:
    """Return the median distance of two markers [m], 0 if they are never seen together."""
    ends = [recording.positions[:, recording.labels.index(name)] for name in (one, other)]
    apart = np.linalg.norm(ends[1] - ends[0], axis=1)
    apart = apart[np.isfinite(apart)]
    return float(np.median(apart)) if apart.size else 0.0
