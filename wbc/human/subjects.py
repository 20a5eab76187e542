"""Selection of one human's markers by the subject's name before each label."""

from __future__ import annotations

from dataclasses import replace

from wbc.errors import UnknownNameError, listed
from wbc.human.bones import LEGS
from wbc.human.landmarks import landmarks_of, missing_landmarks
from wbc.human.markers import MarkerRecording
from wbc.motion.table import RecordingError


def select_subject(
    recording: MarkerRecording, subject: str | None
) -> tuple[MarkerRecording, tuple[str, ...]]:
    """Return the markers of one human, and a note on other named objects.

    ``subject``: the part of its labels before the colon, as in ``Anna:LASI``; None: the only human.
    """
    named = dict[str, list[str]]()
    for label in recording.labels:
        named.setdefault(label.rpartition(":")[0], []).append(label)
    known = [name for name in named if name]
    if subject is not None:
        if subject not in known:
            raise UnknownNameError("subject of the markers", subject, known)
        return _with_labels(recording, named[subject]), ()
    humans = [name for name in known if _is_human(recording, named[name])]
    if len(humans) > 1:
        raise RecordingError(
            f"markers of {len(humans)} humans, {listed(humans, 8)}: choose one,"
            f" subject={humans[0]!r} (--subject {humans[0]})",
            recording.source,
        )
    others = [name for name in known if name not in humans]
    if not humans or not others:
        return recording, ()
    kept = [label for label in recording.labels if label.rpartition(":")[0] not in others]
    return _with_labels(recording, kept), (
        f"markers of other objects left out: {listed(others, 8)}",
    )


def _is_human(recording: MarkerRecording, labels: list[str]) -> bool:
    if recording.landmarks:  # a skeleton's
        marks = dict(zip(recording.labels, recording.landmarks, strict=True))
        return {mark.name for label in labels if (mark := marks[label]) is not None} >= LEGS
    return not missing_landmarks(list(landmarks_of(labels).values()))


def _with_labels(recording: MarkerRecording, labels: list[str]) -> MarkerRecording:
    places = [recording.labels.index(label) for label in labels]
    given = recording.landmarks
    return replace(
        recording,
        labels=tuple(labels),
        positions=recording.positions[:, places],
        landmarks=tuple(given[k] for k in places) if given else (),
    )
