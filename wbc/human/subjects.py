"""Whose markers a recording holds: laboratories put the subject's name before each label."""

from __future__ import annotations

from dataclasses import replace

from wbc.errors import UnknownNameError, listed
from wbc.human.bones import LEGS
from wbc.human.landmarks import lacking, landmarks_of
from wbc.human.markers import MarkerRecording
from wbc.motion.table import RecordingError


def of_subject(
    recording: MarkerRecording, subject: str | None
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the markers of one human, and a note on those of other things that have a name.

    Parameters
    ----------
    subject:
        What stands before the colon of its labels, as in ``Anna:LASI``; None: the only human.

    Raises
    ------
    UnknownNameError
        No label begins so.
    RecordingError
        Several humans, and none was chosen.
    """
    named = dict[str, list[str]]()
    for label in recording.labels:
        named.setdefault(label.rpartition(":")[0], []).append(label)
    known = [name for name in named if name]
    if subject is not None:
        if subject not in known:
            raise UnknownNameError("subject of the markers", subject, known)
        return _only(recording, named[subject]), ()
    humans = [name for name in known if _is_human(recording, named[name])]
    if len(humans) > 1:
        raise RecordingError(
            f"markers of {len(humans)} humans, {listed(humans, 8)}: say whose,"
            f" subject={humans[0]!r} (--subject {humans[0]})",
            recording.source,
        )
    others = [name for name in known if name not in humans]
    if not humans or not others:
        return recording, ()
    kept = [label for label in recording.labels if label.rpartition(":")[0] not in others]
    return _only(recording, kept), (f"markers of other things left out: {listed(others, 8)}",)


def _is_human(recording: MarkerRecording, labels: list[str]) -> bool:
    if recording.landmarks:  # a skeleton's
        marks = dict(zip(recording.labels, recording.landmarks, strict=True))
        return {mark.name for label in labels if (mark := marks[label]) is not None} >= LEGS
    return not lacking(list(landmarks_of(labels).values()))


def _only(recording: MarkerRecording, labels: list[str]) -> MarkerRecording:
    places = [recording.labels.index(label) for label in labels]
    given = recording.landmarks
    return replace(
        recording,
        labels=tuple(labels),
        positions=recording.positions[:, places],
        landmarks=tuple(given[k] for k in places) if given else (),
    )
