"""Targets that several kinds of task share: points and rotations; what is relative is to the start.

Each is a form of the file and a function from it to numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, Field, Tag

from wbc.problem.mistakes import Misplaced
from wbc.problem.section import (
    START,
    Distinct,
    Forms,
    ListOf,
    Name,
    NonEmpty,
    NonNegative,
    Number,
    Point,
    Positive,
    Quaternion,
    Section,
    Words,
    form_of,
)
from wbc.rotations import rotation_from
from wbc.tasks.point import AXES
from wbc.validate import Array

Start = Literal["start"]
Axes = Annotated[NonEmpty[Annotated[str, Words(AXES)]], Distinct]


class Offset(Section):
    """A point given by where it is from its place at the start."""

    offset: Point
    """How far to move from the place at the start [m], world axes."""


PointTarget = Annotated[
    Point | Offset | Start, Forms("[x, y, z] in metres, {offset: [x, y, z]}, or start")
]


class FromPlan(Section):
    """A target that goes as a pendulum's plan says; all tasks of a problem follow the same one."""

    plan: Name
    """The plan: a .npz file that `wbc run` wrote, or the .yaml file that describes what to plan,
    relative to this file. It must have been made for this robot, where it stands."""
    begins: NonNegative = 0.0
    """When the plan begins [s]; until then the target rests where the robot is at the start, and
    after the plan's end at its last place."""


# Kept in step with wbc.retargeting.reference, which is not imported only for these.
BEGINS, EASE = 0.3, 0.5


class FromMotion(Section):
    """A target that goes as a standing motion does; all tasks of a problem follow the same one."""

    motion: Name
    """The motion on both feet: a .npz file that `wbc retarget` wrote, relative to this file."""
    begins: NonNegative = BEGINS
    """When the motion begins [s], from rest; until then the target rests where the motion
    begins, and after the motion's end where it ends."""
    ease: Positive = EASE
    """Time [s] in which the motion gets to its own speed, and at its end to rest."""
    slower: Annotated[float, Field(ge=1.0)] = 1.0
    """Factor on the motion's time."""
    lean: NonNegative | None = None
    """How far inside the soles the CoM is led to keep the CoP [m]; left out: it is not."""


ALIKE = 0.8  # of keys that may be meant: 'position' is not 'motion'
Followed = FromPlan | FromMotion
PLAN, MOTION = Tag("(plan)"), Tag("(motion)")
PlanForm = Annotated[FromPlan, PLAN]
MotionForm = Annotated[FromMotion, MOTION]

LOOP = Tag("(loop)")


class LoopTarget(Section):
    """A closed path of joints that is gone round some times, from rest to rest."""

    loop: Annotated[dict[Name, Annotated[ListOf[Number], Field(min_length=2)]], Field(min_length=1)]
    """By joint, from its value at the start on, Fourier coefficients [rad or m]: those of
    cos(h p) - 1 for h = 1, 2, ..., then those of sin(h p), with a phase p that grows by 2 pi in a
    round. `wbc.flight.planner.plan_turn` finds such paths."""
    cycles: Annotated[int, Field(ge=1, le=1000)] = 1
    """How often it is gone round."""
    period: Positive
    """Mean time for a round [s]."""


def form_with_plan(value: object) -> str | None:
    """Return the tag of the form of a target that may come from a plan or a motion."""
    if isinstance(value, FromPlan):
        return PLAN.tag
    if isinstance(value, FromMotion):
        return MOTION.tag
    if isinstance(value, Mapping) and not isinstance(value, BaseModel):
        words = ("plan", "begins", "motion")
        near = [get_close_matches(str(key), words, n=1, cutoff=ALIKE) for key in value]
        if ["motion"] in near:
            return MOTION.tag
        if any(near):
            return PLAN.tag
    return form_of(value)


def form_with_motion(value: object) -> str | None:
    """Return the tag of the form of a target that may come from a motion."""
    form = form_with_plan(value)
    return form_of(value) if form == PLAN.tag else form


def point(target: Sequence[float] | Offset | str, start: Array) -> Array:
    """Return a wanted position or direction (3,); ``start`` is what it is at the start."""
    if isinstance(target, str):
        return start
    if isinstance(target, Offset):
        return start + np.array(target.offset)
    return np.array(target)


def entries(target: Sequence[float], rows: Sequence[str], all_rows: Sequence[str]) -> Array:
    """Return a wanted vector with all rows, of which a file gives some, or all.

    Raises
    ------
    Misplaced
        Another number of entries.
    """
    if len(target) == len(all_rows):
        return np.array(target, dtype=float)
    if len(target) != len(rows):
        raise Misplaced(
            f"needs {len(rows)} entries ({', '.join(rows)}) or all {len(all_rows)},"
            f" got {len(target)}",
            "target",
        )
    goal = np.zeros(len(all_rows))
    goal[[all_rows.index(row) for row in rows]] = target
    return goal


class Rpy(Section):
    """A rotation by roll, pitch and yaw."""

    rpy: Point
    """Angles [rad] about the fixed world axes x, y, z, in this order: R = Rz(y) Ry(p) Rx(r)."""


class QuaternionTarget(Section):
    """A rotation by a quaternion."""

    quaternion: Quaternion
    """Quaternion (x, y, z, w); it is normalised."""


def _rotation_form(value: object) -> str | None:
    if value == "start":
        return START.tag
    keys = value if isinstance(value, dict) else getattr(type(value), "model_fields", ())
    return next((f"({key})" for key in ("rpy", "quaternion") if key in keys), None)


RotationTarget = Annotated[
    Annotated[Rpy, Tag("(rpy)")] | Annotated[QuaternionTarget, Tag("(quaternion)")] | Start,
    Forms(
        pick=_rotation_form,
        expected="{rpy: [roll, pitch, yaw]} in radians, {quaternion: [x, y, z, w]}, or start",
    ),
]


def _turn_form(value: object) -> str | None:
    form = form_with_motion(value)
    return form if form == MOTION.tag else _rotation_form(value)


TurnTarget = Annotated[
    Annotated[Rpy, Tag("(rpy)")]
    | Annotated[QuaternionTarget, Tag("(quaternion)")]
    | MotionForm
    | Start,
    Forms(
        pick=_turn_form,
        expected="{rpy: [roll, pitch, yaw]} in radians, {quaternion: [x, y, z, w]}, {motion: file},"
        " or start",
    ),
]


def rotation(target: Rpy | QuaternionTarget | str, start: Array) -> Array:
    """Return a wanted rotation (3, 3).

    Raises
    ------
    Misplaced
        A quaternion without length.
    """
    if isinstance(target, Rpy):
        return _from_rpy(*target.rpy)
    if isinstance(target, QuaternionTarget):
        quaternion = np.array(target.quaternion)
        length = float(np.linalg.norm(quaternion))
        if length < 1e-9:
            raise Misplaced("a quaternion needs some length", "target", "quaternion")
        return rotation_from(quaternion / length)
    return start


def _from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll) (3, 3), the convention of URDF."""
    (cr, cp, cy), (sr, sp, sy) = np.cos((roll, pitch, yaw)), np.sin((roll, pitch, yaw))
    return np.array(
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
    )
