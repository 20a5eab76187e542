"""Skeletal motion of a BVH file, as markers at its joints and on its bones."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.human.bones import Bone, bone_markers, joint_landmarks
from wbc.human.markers import MarkerRecording
from wbc.motion.table import RecordingError, read_text, shortened
from wbc.validate import Array

MOST_JOINTS, MOST_FRAMES, DEEPEST = 500, 1_000_000, 100
CHANNELS = {f"{axis}{kind}": (axis, kind) for axis in "XYZ" for kind in ("position", "rotation")}
# Lengths that files are written in [m], most usual first; and what a human's height may be [m].
# Carnegie Mellon's Graphics Lab wrote inches times 0.45, and so are all files made of its own.
UNITS = {"cm": 0.01, "m": 1.0, "inch": 0.0254, "mm": 0.001, "cmu": 0.0254 / 0.45}
HEIGHTS = (1.2, 2.2)
THING = re.compile("prop[0-9]", re.IGNORECASE)


@dataclass
class _Joint:
    name: str
    parent: int
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    channels: list[str] = field(default_factory=list)


def read_bvh(path: Path, unit: str | float | None = None) -> MarkerRecording:
    """Return a BVH file's motion as markers at its joints, and on its bones for their turning.

    Parameters
    ----------
    unit:
        ``cm``, ``m``, ``inch``, ``mm``, ``cmu`` (Carnegie Mellon's, 56.4 mm), or its length [m];
        None: the one of these in which the skeleton is as tall as a human.

    Raises
    ------
    RecordingError
        Unreadable, not such a file, no human's skeleton, or a height that no unit explains.
    """
    source = str(path)
    lines = [line.strip() for line in read_text(path, strict=False).splitlines()]
    start = next((k for k, line in enumerate(lines) if line.upper() == "MOTION"), None)
    if not lines or lines[0].upper() != "HIERARCHY" or start is None:
        raise RecordingError("it has no HIERARCHY and MOTION, as BVH files have", source)
    joints = _hierarchy(lines[1:start], source)
    time, values = _motion(lines, start, sum(len(joint.channels) for joint in joints), source)
    places, turns = _forward(joints, values)
    landmarks = _landmarks(joints, source)
    heights = _height(joints)
    scale, note = _unit(unit, heights, source)
    bones = [
        Bone(joint.name, scale * places[k], turns[k], landmarks.get(k))
        for k, joint in enumerate(joints)
    ]
    return bone_markers(time, bones, source, (note,))


def _landmarks(joints: list[_Joint], source: str) -> dict[int, str]:
    """Return which landmark some joints are, of the only skeleton that is a human's."""
    roots = list[str]()
    for k, joint in enumerate(joints):
        roots.append(f"{k} {joint.name}" if joint.parent < 0 else roots[joint.parent])
    found = joint_landmarks([joint.name for joint in joints], source, roots)
    humans = list(dict.fromkeys(roots[k] for k in found))
    if len(humans) > 1:
        whose = ", ".join(root.partition(" ")[2] for root in humans)
        raise RecordingError(f"skeletons of {len(humans)} humans, {whose}: a file for each", source)
    return found


def _hierarchy(lines: list[str], source: str) -> list[_Joint]:
    """Return the joints, each behind its parent; end sites are joints without channels."""
    joints, stack, opened = list[_Joint](), list[int](), -1
    for number, line in enumerate(lines, 2):
        words = line.split()
        if not words:
            continue
        key = words[0].upper()
        if key in ("ROOT", "JOINT", "END"):
            parent = stack[-1] if stack else -1
            if (key == "ROOT") != (parent < 0):
                raise RecordingError("a root in a joint, or a joint without", source, line=number)
            name = f"{joints[parent].name}/end" if key == "END" else "_".join(words[1:])
            joints.append(_Joint(name, parent))
            opened = len(joints) - 1
            if len(joints) > MOST_JOINTS:
                raise RecordingError(f"over {MOST_JOINTS} joints", source)
        elif key == "{" and opened >= 0:
            stack.append(opened)
            opened = -1
            if len(stack) > DEEPEST:
                raise RecordingError(f"joints are nested over {DEEPEST} deep", source)
        elif key == "}" and stack:
            stack.pop()
        elif key == "OFFSET" and stack:
            joints[stack[-1]].offset = _numbers(words[1:], 3, source, number)
        elif key == "CHANNELS" and stack:
            names = words[2:]
            if any(name not in CHANNELS for name in names) or words[1:2] != [str(len(names))]:
                raise RecordingError(f"channels {shortened(line)!r}", source, line=number)
            joints[stack[-1]].channels = names
        else:
            raise RecordingError(f"{shortened(line)!r} is not expected here", source)
    if stack or not joints:
        raise RecordingError("its hierarchy is not closed", source)
    return joints


def _numbers(words: list[str], count: int, source: str, line: int | None = None) -> list[float]:
    try:
        found = [float(word) for word in words]
    except ValueError:
        found = []
    if len(found) != count or not np.isfinite(found).all():
        text = shortened(" ".join(words))
        where = "" if line is None else f" in line {line}"
        raise RecordingError(f"expected {count} numbers{where}, got {text!r}", source)
    return found


def _motion(lines: list[str], start: int, width: int, source: str) -> tuple[Array, Array]:
    """Return times (n,) [s] and channel values (n, width)."""
    head = [line.split(":")[-1].split() for line in lines[start + 1 : start + 3]]
    if len(head) < 2:
        raise RecordingError("its motion has no frames", source)
    step = _numbers(head[1], 1, source, start + 3)[0]
    if not 1e-5 <= step <= 10.0:
        raise RecordingError(f"its frame time is {step:g} s", source)
    rows = [
        _numbers(line.split(), width, source, number)
        for number, line in enumerate(lines[start + 3 :], start + 4)
        if line
    ]
    if not 0 < len(rows) <= MOST_FRAMES:
        raise RecordingError(f"it has {len(rows)} frames", source)
    told = _numbers(head[0], 1, source, start + 2)[0]
    if told != len(rows):
        what = f"it tells of {told:g} frames and has {len(rows)}; is it cut off?"
        raise RecordingError(what, source)
    return step * np.arange(len(rows)), np.array(rows)


def _forward(joints: list[_Joint], values: Array) -> tuple[list[Array], list[Array]]:
    """Return places (n, 3) in the file's unit and rotations (n, 3, 3) of all joints."""
    places, turns, column, count = list[Array](), list[Array](), 0, len(values)
    for joint in joints:
        local = np.tile(np.array(joint.offset), (count, 1))
        R = np.tile(np.eye(3), (count, 1, 1))
        moved = [name for name in joint.channels if name.endswith("position")]
        if moved:  # in place of the offset
            local = np.zeros((count, 3)) if joint.parent < 0 else local
        for name in joint.channels:
            axis, kind = CHANNELS[name]
            if kind == "position":
                local[:, "XYZ".index(axis)] = values[:, column]
            else:
                R = R @ Rotation.from_euler(axis, values[:, [column]], degrees=True).as_matrix()
            column += 1
        if joint.parent >= 0:
            parent = turns[joint.parent]
            local = places[joint.parent] + (parent @ local[..., None])[..., 0]
            R = parent @ R
        places.append(local)
        turns.append(R)
    return places, turns


def _height(joints: list[_Joint]) -> float:
    """Return the largest extent of the skeleton as it is drawn, in the file's unit.

    Joints that carry all others may be drawn anywhere; things that Xsens tracks, its props, too.
    """
    parents = [joint.parent for joint in joints]
    trunk = next((k for k in range(len(joints)) if parents.count(k) > 1), 0)
    rest = list[Array]()
    for k, joint in enumerate(joints):
        at = np.array(joint.offset) if k > trunk else np.zeros(3)
        rest.append(at + (rest[joint.parent] if joint.parent >= 0 else 0.0))
    body = [at for at, joint in zip(rest, joints, strict=True) if not THING.match(joint.name)]
    return float(np.ptp(np.array(body or rest), axis=0).max())


def _unit(unit: str | float | None, height: float, source: str) -> tuple[float, str]:
    if unit is not None:
        if str(unit) in UNITS:
            return UNITS[str(unit)], f"lengths in {unit}, as was said"
        try:
            size = float(unit)
        except (TypeError, ValueError):
            size = math.nan
        if not 0.0 < size < math.inf:
            what = f"unit: expected {', '.join(UNITS)} or a length in m, got {unit!r}"
            raise RecordingError(what, source)
        return size, f"lengths in {unit} m, as was said"
    for name, size in UNITS.items():
        if HEIGHTS[0] <= height * size <= HEIGHTS[1]:
            tall = f"its skeleton extends over {height * size:.2f} m"
            return size, f"lengths taken for {name}: {tall}"
    raise RecordingError(
        f"its skeleton extends over {height:.4g}: in no usual unit a human; say in which one, or"
        " how long that is in m (unit)",
        source,
    )
