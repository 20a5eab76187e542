"""Pose parameters of SMPL, SMPL-H and SMPL-X as AMASS has them, as markers on the bones.

Only the arrays of a file are read. Its body shape needs a model that is not free; the bones have
usual proportions.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.human.anthropometry import check_build
from wbc.human.body import MIDDLE_TRUNK, HumanBody
from wbc.human.bones import Bone, bone_markers
from wbc.human.markers import MarkerRecording
from wbc.motion.table import NUMBERS, RecordingError, check_file, read_recorded
from wbc.validate import Array, finite_array

STATURE, MASS, SEX = 1.70, 70.0, "male"  # of the bones, whose mass does not matter
RATES = ("mocap_framerate", "mocap_frame_rate", "fps", "framerate")
# Names of the arrays in AMASS, and in files of SMPL-X's own package.
ARRAY_NAMES = {
    "poses": ("poses",),
    "trans": ("trans", "transl"),
    "root_orient": ("root_orient", "global_orient"),
    "pose_body": ("pose_body", "body_pose"),
}
PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)
JOINTS = (  # noqa: SIM905
    "pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3"
    " left_foot right_foot neck left_collar right_collar head left_shoulder right_shoulder"
    " left_elbow right_elbow left_wrist right_wrist"
).split()
_LANDMARKS = {"pelvis": "root", "neck": "neck_centre", "head": "head_centre"}
_PAIRED = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")


def is_smpl(names: Collection[str]) -> bool:
    """Return whether arrays of these names are pose parameters."""
    there = {key for key, words in ARRAY_NAMES.items() if any(word in names for word in words)}
    return "trans" in there and ("poses" in there or "pose_body" in there)


def read_smpl(path: Path, stature: float | None = None) -> MarkerRecording:
    """Return an AMASS-like NPZ's motion as markers at joints and on bones.

    Arrays ``poses`` (n, 66 or more; or n, 22 or more, 3), rotation vectors of pelvis and joints, or
    ``root_orient`` and ``pose_body`` (or ``global_orient`` and ``body_pose``); ``trans`` (or
    ``transl``) (n, 3) [m]; and ``mocap_framerate`` (or ``mocap_frame_rate``, ``fps``) [Hz].

    ``stature``: of the bones [m].

    Raises RecordingError: unreadable, without these arrays, or of other shapes.
    """
    source = str(path)
    _, stature = check_build(None, stature)
    check_file(path)
    wanted = (*(word for words in ARRAY_NAMES.values() for word in words), *RATES)
    arrays = read_recorded(path, lambda _: wanted, lambda _: NUMBERS)
    found = dict[str, Array]()
    for key, words in ARRAY_NAMES.items():
        word = next((word for word in words if word in arrays), None)
        if word is None:
            continue
        one = arrays[word]
        if one.ndim > 3 or (one.ndim == 3 and one.shape[2] != 3):
            what = f"{word} have shape {one.shape}; expected rotation vectors, (n, joints, 3)"
            raise RecordingError(f"{what}, not matrices or quaternions", source)
        found[key] = one.reshape(len(one), -1) if one.ndim > 1 else one
    if "poses" in found:
        poses = found["poses"]
    elif "pose_body" in found and "root_orient" in found:
        parts = found["root_orient"], found["pose_body"]
        if any(part.ndim != 2 for part in parts) or len(parts[0]) != len(parts[1]):
            raise RecordingError("root_orient and pose_body differ in length", source)
        poses = np.hstack(parts)
    else:
        what = "it has no array poses, nor root_orient and pose_body: no human's pose parameters"
        raise RecordingError(f"{what}, as SMPL, AMASS and SMPL-X have them", source)
    if poses.ndim != 2 or poses.shape[1] < 66:
        raise RecordingError(f"poses have shape {poses.shape}; expected (n, 66 or more)", source)
    rate = next((arrays[name].ravel() for name in RATES if name in arrays), np.zeros(0))
    if rate.size != 1 or not 0.0 < rate[0] <= 1e5:
        raise RecordingError(f"it has no rate; add an array {' or '.join(RATES[:2])}", source)
    count = len(poses)
    vectors = finite_array(f"{source}: poses", poses[:, :66].astype(float), (count, 66))
    trans = finite_array(f"{source}: trans", found.get("trans", np.zeros(0)), (count, 3))
    bones = _bones(vectors.reshape(count, 22, 3), trans, STATURE if stature is None else stature)
    note = (
        "bones of usual proportions: the file's body shape needs a model that is not read, and its"
        " gender is not read either: give sex"
    )
    return bone_markers(np.arange(count) / float(rate[0]), bones, source, (note,))


def _bones(vectors: Array, trans: Array, stature: float) -> list[Bone]:
    offsets = _rest_offsets(stature)
    count = len(vectors)
    local = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix().reshape(count, 22, 3, 3)
    bones = list[Bone]()
    for k, name in enumerate(JOINTS):
        R, at = local[:, k], trans
        if PARENTS[k] >= 0:
            parent = bones[PARENTS[k]]
            R = parent.rotation @ R
            at = parent.place + parent.rotation @ offsets[k]
        side, _, rest = name.partition("_")
        mark = _LANDMARKS.get(name)
        if rest in _PAIRED:
            mark = f"{name}_centre"
        elif rest == "foot":
            mark = f"{side}_toe"
        bones.append(Bone(name, at, R, mark))
    return bones


def _rest_offsets(stature: float) -> Array:
    """Return offsets (22, 3) [m] from joint to joint: T-pose, x to the left, y up, z forward."""
    body, found = HumanBody.of(stature, MASS, SEX), np.zeros((22, 3))
    low, high = body.size("lumbar_z"), body.size("neck_z")
    chest = MIDDLE_TRUNK * high
    for name, (x, y, z) in {
        "hip": (body.size("hip_y"), 0.0, 0.0),
        "knee": (0.0, -body.size("thigh"), 0.0),
        "ankle": (0.0, -body.size("shank"), 0.0),
        "foot": (0.0, -0.055 * body.scale, 0.15 * body.scale),
        "collar": (0.05 * body.scale, body.size("shoulder_z") - chest - 0.03, 0.0),
        "shoulder": (body.size("shoulder_y") - 0.05 * body.scale, 0.03, 0.0),
        "elbow": (body.size("upper_arm"), 0.0, 0.0),
        "wrist": (body.size("forearm"), 0.0, 0.0),
    }.items():
        found[JOINTS.index(f"left_{name}")] = x, y, z
        found[JOINTS.index(f"right_{name}")] = -x, y, z
    for name, rise in {
        "spine1": low,
        "spine2": 0.5 * chest,
        "spine3": 0.5 * chest,
        "neck": high - chest,
        "head": 0.09 * body.scale,
    }.items():
        found[JOINTS.index(name)] = 0.0, rise, 0.0
    return found
