"""Named postures: from an SRDF, from key frames, from the library; and standing on the ground."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError
from wbc.robot.description import State
from wbc.robot.feet import Foot
from wbc.robot.frames import frame_table
from wbc.robot.library import NamedRobot
from wbc.robot.limits import BASE_NQ, Limits
from wbc.robot.locking import place_joint
from wbc.robot.names import matches, matching
from wbc.robot.reading import read_xml
from wbc.validate import Array

NEUTRAL, STANDING, HALF_SITTING = "neutral", "standing", "half_sitting"


def read_states(srdf: Path) -> dict[str, State]:
    """Return the ``group_state`` entries of an SRDF: state name to joint to its coordinates.

    Raises
    ------
    ModelError
        Not a readable SRDF, or a value that is not made of numbers.
    """
    root = read_xml(srdf)
    if root.tag != "robot":
        raise ModelError(f"{srdf}: the root element is <{root.tag}>; an SRDF begins with <robot>")
    return {
        group.get("name", "?"): dict(_joint_values(group, srdf))
        for group in root.findall("group_state")
    }


def _joint_values(group: ET.Element, srdf: Path) -> Iterable[tuple[str, tuple[float, ...]]]:
    for joint in group.findall("joint"):
        text = joint.get("value", "")
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError as error:
            raise ModelError(
                f"{srdf}: state {group.get('name')!r}, joint {joint.get('name')!r}: {text!r} is"
                " not made of numbers"
            ) from error
        norm = math.fsum(value * value for value in values)
        if not math.isfinite(norm) or (len(values) == BASE_NQ and not any(values[3:])):
            raise ModelError(
                f"{srdf}: state {group.get('name')!r}, joint {joint.get('name')!r}: {text!r} is"
                " not a configuration (x, y, z, quaternion x, y, z, w for the base)"
            )
        yield joint.get("name", "?"), values


def named_postures(
    limits: Limits,
    neutral: Array,
    states: Mapping[str, State],
    known: NamedRobot | None,
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return the postures of a robot by name, not yet set on the ground, and notes.

    ``neutral`` (every joint at 0) and ``standing`` are always there. A robot the library does not
    know stands as its own state ``standing`` or ``half_sitting`` says, or else in the neutral
    posture brought within the limits.
    """
    postures, notes = {NEUTRAL: neutral.copy()}, list[str]()
    for name, state in states.items():
        postures[name], note = _posture_of(limits, neutral, name, state)
        notes += note
    if known is not None:
        q = neutral.copy()
        q[3:BASE_NQ] = known.base_quaternion
        # The user may have locked joints that the library's posture names.
        free = {key: value for key, value in known.standing.items() if matches(key, limits.names)}
        set_joints(limits, q, free)
        postures[STANDING] = q
    elif STANDING not in postures:
        postures[STANDING] = postures.get(HALF_SITTING, within_limits(limits, neutral))
    return postures, tuple(notes)


def _posture_of(limits: Limits, neutral: Array, name: str, state: State) -> tuple[Array, list[str]]:
    """Return the posture of a state; joints that the model does not have (locked) are skipped."""
    q = neutral.copy()
    outside = []
    for joint, values in state.items():
        if len(values) == BASE_NQ:
            q[:BASE_NQ] = values
            q[3:BASE_NQ] /= np.linalg.norm(q[3:BASE_NQ])
        if joint not in limits.names:
            continue
        value = values[0] if len(values) == 1 else float(np.arctan2(values[1], values[0]))
        k = limits.names.index(joint)
        inside = min(max(value, float(limits.lower[k])), float(limits.upper[k]))
        if abs(inside - value) > 1e-6:  # more than the file's rounding
            outside.append(joint)
        place_joint(limits, q, joint, inside)
    if outside:
        return q, [f"posture {name!r}: brought within the limits: {', '.join(outside)}"]
    return q, []


def within_limits(limits: Limits, q: Array) -> Array:
    """Return ``q`` with every joint that has a range moved to the nearest value in it."""
    q = q.copy()
    for k, start in enumerate(limits.starts):
        if k not in limits.unbounded:
            q[start] = min(max(q[start], limits.lower[k]), limits.upper[k])
    return q


def set_joints(limits: Limits, q: Array, joints: Mapping[str, float]) -> None:
    """Write joint values into ``q``; keys are joint names or patterns such as ``left_*``.

    Raises
    ------
    UnknownNameError
        A key matches no joint.
    InvalidInputError
        A value is not finite or outside the joint's limits.
    """
    for pattern, value in joints.items():
        for k in matching(pattern, limits.names):
            place_joint(limits, q, limits.names[k], value)


def grounded(model: pin.Model, q: Array, feet: Mapping[str, Foot]) -> Array:
    """Return ``q`` raised or lowered so that the lowest corner of the soles is at z = 0.

    Without feet nothing is moved.
    """
    if not feet:
        return q
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    frames = frame_table(model)
    lowest = np.inf
    for foot in feet.values():
        pose = data.oMf[frames[foot.frame]]
        heights = foot.polygon @ pose.rotation[2, :2] + pose.translation[2]
        lowest = min(lowest, float(heights.min()))
    q = q.copy()
    q[2] -= lowest
    return q
