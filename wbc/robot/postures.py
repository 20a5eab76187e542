"""Named postures: from an SRDF, from key frames, from the library; and standing on the ground."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from wbc.robot.feet import Foot
from wbc.robot.formats.description import State
from wbc.robot.library import NamedRobot
from wbc.robot.limits import BASE_NQ, Limits
from wbc.robot.names import frame_table, matches, matching
from wbc.validate import Array

NEUTRAL, STANDING, HALF_SITTING = "neutral", "standing", "half_sitting"


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
        postures[STANDING] = postures.get(HALF_SITTING, limits.clamped(neutral))
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
        limits.set_joint(q, joint, inside)
    if outside:
        return q, [f"posture {name!r}: brought within the limits: {', '.join(outside)}"]
    return q, []


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
            limits.set_joint(q, limits.names[k], value)


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
