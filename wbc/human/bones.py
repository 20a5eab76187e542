"""Animated skeletons as markers: at the joints, and on the bones for their rotations.

An animation's joint is taken for the joint's centre. Three more points move with each bone; their
places on the human's segment are calibrated, since rest poses differ.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wbc.human.landmarks import Landmark, landmark
from wbc.human.markers import MarkerRecording
from wbc.motion.table import RecordingError
from wbc.validate import Array

LEGS = frozenset(f"{s}_{n}_centre" for s in ("left", "right") for n in ("hip", "knee", "ankle"))
REACH = 0.1  # m, of a bone's points from its joint
PLACE_SPREAD, NOISE = 0.3, 0.02  # m, standard deviations of such points
# Names of joints without the side, most preferred first. LEG is the thigh only where the shank has
# another name.
_PAIRED = {
    "knee_centre": "LOWLEG LOWERLEG KNEE SHIN CALF TIBIA LEG",
    "hip_centre": "UPLEG UPPERLEG HIP THIGH UPLEGROLL FEMUR HIPJOINT LEG",
    "ankle_centre": "ANKLE FOOT",
    "toe": "TOEBASE TOE TOES BALL TOE0 FOOTINDEX FOOT FOOT/END ANKLE/END",
    "shoulder_centre": "ARM UPARM UPPERARM UARM SHLDR SHOULDER HUMERUS",
    "elbow_centre": "FOREARM LOWARM LOWERARM FARM ELBOW RADIUS",
    "wrist_centre": "WRIST HAND",
}
_MIDDLE = {
    "root": "HIPS PELVIS HIP ROOT REFERENCE",
    "neck_centre": "NECK NECK1 NECK01 LOWERNECK",
    "head_centre": "HEAD",
    "head_top": "HEAD/END",
}
SEGMENT_OF = {
    "hip_centre": "thigh",
    "knee_centre": "shank",
    "ankle_centre": "foot",
    "shoulder_centre": "upper_arm",
    "elbow_centre": "forearm",
    "wrist_centre": "hand",
    "root": "pelvis",
    "head_centre": "head",
}


@dataclass(frozen=True, eq=False)
class Bone:
    """A joint of an animation, and its bone."""

    name: str
    place: Array  # (n, 3) [m]
    rotation: Array  # (n, 3, 3)
    landmark: str | None  # of its joint; None: the human's model has none


def joint_landmarks(
    names: Sequence[str], source: str, owners: Sequence[str] | None = None
) -> dict[int, str]:
    """Return the landmarks of an animation's joints, by index.

    ``owners``: the skeleton of each joint; None: the part of its name before the colon. All with
    legs are humans.
    """
    owners = [name.rpartition(":")[0] for name in names] if owners is None else owners
    plain = [_normalized(name) for name in names]
    found = dict[int, str]()
    for owner in dict.fromkeys(owners):
        own = [p if other == owner else "" for p, other in zip(plain, owners, strict=True)]
        one = _landmarks_of(own)
        found |= one if set(one.values()) >= LEGS else {}
    found = found or _landmarks_of(plain)
    missing = sorted(LEGS - set(found.values()))
    if missing:
        raise RecordingError(
            f"its skeleton has no {', '.join(missing)} by the usual names (LeftUpLeg, LeftLeg,"
            " LeftFoot, ...); rename its joints",
            source,
        )
    return found


def _landmarks_of(plain: Sequence[str]) -> dict[int, str]:
    found = dict[int, str]()
    for side, marks in (("left", ("LEFT", "L")), ("right", ("RIGHT", "R"))):
        for name, words in _PAIRED.items():
            for word in words.split():
                hit = next((k for k, p in enumerate(plain) if p in _sided(word, marks)), None)
                if hit is not None and hit not in found:
                    found[hit] = f"{side}_{name}"
                    break
    for name, words in _MIDDLE.items():
        hit = next((plain.index(word) for word in words.split() if word in plain), None)
        if hit is not None and hit not in found:
            found[hit] = name
    return found


def _normalized(name: str) -> str:
    name = name.rpartition(":")[2].upper()
    name = re.sub(r"^(MIXAMORIG|BIP01|BIP001|CHARACTER1|J_BIP(_C)?)_?", "", name)
    return re.sub(r"[^A-Z0-9/]+", "", name)


def _sided(word: str, marks: Sequence[str]) -> set[str]:
    base, slash, end = word.partition("/")
    tail = slash + end
    return {f"{mark}{base}{tail}" for mark in marks} | {f"{base}{mark}{tail}" for mark in marks}


def bone_markers(
    time: Array, bones: Sequence[Bone], source: str, notes: tuple[str, ...]
) -> MarkerRecording:
    """Return a recording of markers at the joints and on the bones of an animation.

    The trunk has no points of a bone: joints of shoulders, neck and head tell its pose.
    """
    labels, tracks, marks = list[str](), list[Array](), list[Landmark | None]()
    for bone in bones:
        if bone.landmark is None:
            continue
        labels.append(bone.name)
        tracks.append(bone.place)
        marks.append(landmark(bone.landmark))
        side, _, rest = bone.landmark.partition("_")
        paired = side in ("left", "right")
        segment = SEGMENT_OF.get(rest if paired else bone.landmark)
        if segment is None:
            continue
        segment = f"{side}_{segment}" if paired else segment
        for axis, letter in enumerate("xyz"):
            label = f"{bone.name}/{letter}"
            labels.append(label)
            tracks.append(bone.place + REACH * bone.rotation[:, :, axis])
            marks.append(Landmark(label, segment, segment, (0.0, 0.0, 0.0), PLACE_SPREAD, NOISE))
    return MarkerRecording(
        time,
        tuple(labels),
        np.stack(tracks, axis=1),
        source=source,
        notes=notes,
        landmarks=tuple(marks),
    )
