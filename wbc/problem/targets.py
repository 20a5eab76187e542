"""Targets that several kinds of task share: points and rotations; what is relative is to the start.

Each is a form of the file and a function from it to numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from wbc.problem.mistakes import Misplaced
from wbc.problem.section import (
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


Followed = FromPlan | FromMotion


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


def point(target: Sequence[float] | Offset | str, start: Array) -> Array:
    """Return a wanted position or direction (3,); ``start`` is what it is at the start."""
    if isinstance(target, str):
        return start
    if isinstance(target, Offset):
        return start + np.array(target.offset)
    return np.array(target)


def entries(target: Sequence[float], rows: Sequence[str], all_rows: Sequence[str]) -> Array:
    """Return a wanted vector with all rows, of which a file gives some, or all.

    Raises Misplaced: another number of entries.
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


_ROTATIONS = "{rpy: [roll, pitch, yaw]} in radians, {quaternion: [x, y, z, w]},"
RotationTarget = Annotated[Rpy | QuaternionTarget | Start, Forms(f"{_ROTATIONS} or start")]
TurnTarget = Annotated[
    Rpy | QuaternionTarget | FromMotion | Start, Forms(f"{_ROTATIONS} {{motion: file}}, or start")
]


def rotation(target: Rpy | QuaternionTarget | str, start: Array) -> Array:
    """Return a wanted rotation (3, 3). Raises Misplaced: a quaternion without length."""
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
