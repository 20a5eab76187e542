"""Skeletal motion of a BVH file, as markers at its joints and on its bones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.human.bones import Bone, bone_markers, joint_landmarks
from wbc.human.markers import MarkerRecording
from wbc.motion.table import RecordingError, read_text, shortened
from wbc.validate import Array

MAX_JOINTS, MAX_FRAMES, MAX_DEPTH = 500, 1_000_000, 100
CHANNELS = {f"{axis}{kind}": (axis, kind) for axis in "XYZ" for kind in ("position", "rotation")}
# Units of length [m], most usual first, and the range of a human's height [m]. Carnegie Mellon's
# Graphics Lab wrote inches times 0.45, as do all files made from theirs. Units differ by more than
# heights, so that one fits.
UNITS = {"cm": 0.01, "m": 1.0, "inch": 0.0254, "mm": 0.001, "cmu": 0.0254 / 0.45}
HEIGHTS = (1.0, 2.2)
LEG = 0.49  # from hip to ankle, by the stature (de Leva 1996)


@dataclass
class _Joint:
    name: str
    parent: int
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    channels: list[str] = field(default_factory=list)


def read_bvh(path: Path, unit: str | float | None = None) -> MarkerRecording:
    """Return a BVH file's motion as markers at its joints, and on its bones for their rotations.

    ``unit``: ``cm``, ``m``, ``inch``, ``mm``, ``cmu`` (Carnegie Mellon's, 56.4 mm), or its length
    [m]; None: the first in which its legs are as long as a human's.

    Raises RecordingError: unreadable, not such a file, no human's skeleton, or legs of no human in
    any unit.
    """
    source = str(path)
    lines = [line.strip() for line in read_text(path, strict=False).splitlines()]
    start = next((k for k, line in enumerate(lines) if line.upper() == "MOTION"), None)
    if not lines or lines[0].upper() != "HIERARCHY" or start is None:
        raise RecordingError("it has no HIERARCHY and MOTION, as BVH files have", source)
    joints = _hierarchy(lines[1:start], source)
    time, values = _motion(lines, start, sum(len(joint.channels) for joint in joints), source)
    places, rotations = _forward_kinematics(joints, values)
    landmarks = _landmarks(joints, source)
    scale, note = _unit(unit, _stature(places, landmarks), source)
    bones = [
        Bone(joint.name, scale * places[k], rotations[k], landmarks.get(k))
        for k, joint in enumerate(joints)
    ]
    return bone_markers(time, bones, source, (note,))


def _landmarks(joints: list[_Joint], source: str) -> dict[int, str]:
    """Return the landmarks of joints of the only human skeleton."""
    roots = list[str]()
    for k, joint in enumerate(joints):
        roots.append(f"{k} {joint.name}" if joint.parent < 0 else roots[joint.parent])
    found = joint_landmarks([joint.name for joint in joints], source, roots)
    humans = list(dict.fromkeys(roots[k] for k in found))
    if len(humans) > 1:
        names = ", ".join(root.partition(" ")[2] for root in humans)
        raise RecordingError(
            f"skeletons of {len(humans)} humans, {names}: write a file for each", source
        )
    return found


def _hierarchy(lines: list[str], source: str) -> list[_Joint]:
    """Return the joints, each after its parent; end sites are joints without channels."""
    joints, stack, opened = list[_Joint](), list[int](), -1
    for number, line in enumerate(lines, 2):
        words = line.split()
        if not words:
            continue
        key = words[0].upper()
        if key in ("ROOT", "JOINT", "END"):
            parent = stack[-1] if stack else -1
            if (key == "ROOT") != (parent < 0):
                what = "a root in a joint, or a joint outside a root"
                raise RecordingError(what, source, line=number)
            name = f"{joints[parent].name}/end" if key == "END" else "_".join(words[1:])
            joints.append(_Joint(name, parent))
            opened = len(joints) - 1
            if len(joints) > MAX_JOINTS:
                raise RecordingError(f"over {MAX_JOINTS} joints", source)
        elif key == "{" and opened >= 0:
            stack.append(opened)
            opened = -1
            if len(stack) > MAX_DEPTH:
                raise RecordingError(f"joints are nested over {MAX_DEPTH} deep", source)
        elif key == "}" and stack:
            stack.pop()
        elif key == "OFFSET" and stack:
            joints[stack[-1]].offset = _numbers(words[1:], 3, source, number)
        elif key == "CHANNELS" and stack:
            names = words[2:]
            if any(name not in CHANNELS for name in names) or words[1:2] != [str(len(names))]:
                what = f"unknown or miscounted channels {shortened(line)!r}"
                raise RecordingError(what, source, line=number)
            joints[stack[-1]].channels = names
        else:
            raise RecordingError(f"{shortened(line)!r} is not expected here", source, line=number)
    if stack or not joints:
        raise RecordingError("its hierarchy is not closed", source)
    return joints


def _numbers(words: list[str], count: int, source: str, line: int) -> list[float]:
    try:
        found = [float(word) for word in words]
    except ValueError:
        found = []
    if len(found) != count or not np.isfinite(found).all():
        text = shortened(" ".join(words))
        raise RecordingError(f"expected {count} numbers, got {text!r}", source, line=line)
    return found


def _motion(lines: list[str], start: int, width: int, source: str) -> tuple[Array, Array]:
    """Return times (n,) [s] and channel values (n, width)."""
    filled = [(k, line) for k, line in enumerate(lines[start + 1 :], start + 2) if line]
    if len(filled) < 2:
        raise RecordingError("its motion has no frames", source)
    declared, step = (
        _numbers(line.split(":")[-1].split(), 1, source, k)[0] for k, line in filled[:2]
    )
    if not 1e-5 <= step <= 10.0:
        raise RecordingError(f"its frame time is {step:g} s", source)
    rows = [_numbers(line.split(), width, source, k) for k, line in filled[2:]]
    if not 0 < len(rows) <= MAX_FRAMES:
        raise RecordingError(f"it has {len(rows)} frames", source)
    if declared != len(rows):
        what = f"it declares {declared:g} frames and has {len(rows)}; is it cut off?"
        raise RecordingError(what, source)
    return step * np.arange(len(rows), dtype=float), np.array(rows)


def _forward_kinematics(joints: list[_Joint], values: Array) -> tuple[list[Array], list[Array]]:
    """Return positions (n, 3) in the file's unit and rotations (n, 3, 3) of all joints."""
    places, rotations, column, count = list[Array](), list[Array](), 0, len(values)
    for joint in joints:
        local = np.tile(np.array(joint.offset), (count, 1))
        R = np.tile(np.eye(3), (count, 1, 1))
        if any(name.endswith("position") for name in joint.channels):  # in place of the offset
            local = np.zeros((count, 3)) if joint.parent < 0 else local
        for name in joint.channels:
            axis, kind = CHANNELS[name]
            if kind == "position":
                local[:, "XYZ".index(axis)] = values[:, column]
            else:
                R = R @ Rotation.from_euler(axis, values[:, [column]], degrees=True).as_matrix()
            column += 1
        if joint.parent >= 0:
            parent = rotations[joint.parent]
            local = places[joint.parent] + (parent @ local[..., None])[..., 0]
            R = parent @ R
        places.append(local)
        rotations.append(R)
    return places, rotations


def _stature(places: list[Array], landmarks: Mapping[int, str]) -> float:
    """Return the stature that belongs to the skeleton's legs, in the file's unit.

    Its rest pose does not tell: bones may point anywhere in it, as all along x in LAFAN1.
    """
    at = {name: places[k] for k, name in landmarks.items()}
    bones = [
        np.linalg.norm(at[f"{side}_{end}_centre"] - at[f"{side}_{start}_centre"], axis=1)
        for side in ("left", "right")
        for start, end in (("hip", "knee"), ("knee", "ankle"))
    ]
    return float(np.median(bones, axis=1).sum()) / (2.0 * LEG)


def _unit(unit: str | float | None, height: float, source: str) -> tuple[float, str]:
    if unit is not None:
        if str(unit) in UNITS:
            return UNITS[str(unit)], f"lengths in {unit}, as given"
        try:
            size = float(unit)
        except (TypeError, ValueError):
            size = math.nan
        if not 0.0 < size < math.inf:
            what = f"unit: expected {', '.join(UNITS)} or a length in m, got {unit!r}"
            raise RecordingError(what, source)
        return size, f"lengths in {unit} m, as given"
    for name, size in UNITS.items():
        if HEIGHTS[0] <= height * size <= HEIGHTS[1]:
            return size, f"lengths taken for {name}: by its legs it is {height * size:.2f} m tall"
    raise RecordingError(
        f"by its legs it is {height:.4g} tall: in no usual unit a human's height; give the unit, or"
        " its length in m (unit)",
        source,
    )
