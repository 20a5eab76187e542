"""Which markers of a recording are known, and which of its axes points up."""

from __future__ import annotations

import numpy as np

from wbc.errors import listed
from wbc.human.landmarks import Landmark, lacking, landmark, landmark_of
from wbc.human.markers import MarkerRecording
from wbc.motion.table import RecordingError

UPRIGHT = 0.8  # cosine between the way from feet to trunk and the axis that is taken for up


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
        for label, mark in zip(one.labels, given, strict=True):
            # Plug-in Gait writes its segments' axes as if they were markers: LCLA is no clavicle.
            axis = label[-1:] in "OALP" and all(label[:-1] + end in one.labels for end in "OALP")
            name = None if axis else landmark_of(label)
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
    arms = {found[n].segment for n in own}
    without = [s for s in ("head", "left_forearm", "right_forearm") if s not in arms]
    if without:
        notes.append(f"no markers on {', '.join(without)}: held as they usually are")
    return names, tuple(found[name] for name in names), tuple(notes)


def upright(
    recording: MarkerRecording, names: tuple[str, ...], marks: tuple[Landmark, ...], up: str | None
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the recording with z up, and a note if that axis was found, not said.

    Raises
    ------
    RecordingError
        From feet to trunk leads along none of the axes.
    """
    axis = up if up is not None else recording.up
    if axis is not None:
        return recording.upright(axis), ()
    high, low = (
        [
            recording.labels.index(name)
            for name, mark in zip(names, marks, strict=True)
            if name in recording.labels and any(part in mark.segment for part in parts)
        ]
        for parts in (("trunk", "pelvis"), ("foot", "shank"))
    )
    way = np.nanmedian(recording.positions[:, high], axis=(0, 1))
    way = way - np.nanmedian(recording.positions[:, low], axis=(0, 1))
    way /= np.linalg.norm(way)
    k = int(np.abs(way).argmax())
    if not way[k] > UPRIGHT:
        raise RecordingError(
            f"from feet to trunk leads ({way[0]:.2f}, {way[1]:.2f}, {way[2]:.2f}), along none of"
            " the axes x, y, z: say which one points up (up)",
            recording.source,
        )
    return recording.upright("xyz"[k]), (f"{'xyz'[k]} taken for up, from feet to trunk",)
