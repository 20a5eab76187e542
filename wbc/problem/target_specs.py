"""Targets as a problem file gives them: absolute, relative to the start, or the start itself."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Annotated, Literal

from pydantic import BaseModel, Discriminator, Field, Strict, Tag

from wbc.problem.section import (
    LIST,
    MAPPING,
    MATRIX,
    NUMBER,
    START,
    WORD,
    Name,
    NonNegative,
    Number,
    Point,
    Quaternion,
    Section,
    form_of,
    forms,
)

Start = Literal["start"]
OVER = Tag("(over)")


class Offset(Section):
    """A point given by where it is from its place at the start."""

    offset: Point
    """How far to move from the place at the start [m], world axes."""


class Over(Section):
    """A place of the CoM above what the robot stands on."""

    over: Name
    """A foot, or double for left and right together: the middle of its sole, or half way between
    the two, where they are when the target is set."""
    height: Number | None = None
    """Height above the ground [m]; as it was if left out."""


class Rpy(Section):
    """A rotation by roll, pitch and yaw."""

    rpy: Point
    """Angles [rad] about the fixed world axes x, y, z, in this order: R = Rz(y) Ry(p) Rx(r)."""


class QuaternionTarget(Section):
    """A rotation by a quaternion."""

    quaternion: Quaternion
    """Quaternion (x, y, z, w); it is normalised."""


class Scale(Section):
    """An inertia given by factors on the one at the start."""

    scale: Annotated[
        Annotated[NonNegative, NUMBER]
        | Annotated[
            tuple[NonNegative, ...], Strict(False), Field(min_length=3, max_length=3), LIST
        ],
        forms("one factor, or three for the diagonal entries (or the principal moments)"),
    ]
    """One factor for every component, or three for xx, yy, zz (or the principal moments)."""


PointTarget = Annotated[
    Annotated[Point, LIST] | Annotated[Offset, MAPPING] | Annotated[Start, START],
    forms("[x, y, z] in metres, {offset: [x, y, z]}, or start"),
]


def _com_form(value: object) -> str | None:
    """Tell the two mappings apart by the key that their first key is nearest to."""
    if isinstance(value, BaseModel):
        return OVER.tag if isinstance(value, Over) else MAPPING.tag
    if not isinstance(value, Mapping):
        return form_of(value)
    near = [get_close_matches(str(key), ("offset", "over", "height"), n=1) for key in value]
    return MAPPING.tag if ["offset"] in near or not any(near) else OVER.tag


ComTarget = Annotated[
    Annotated[Point, LIST]
    | Annotated[Offset, MAPPING]
    | Annotated[Over, OVER]
    | Annotated[Start, START],
    Discriminator(
        _com_form,
        custom_error_type="form",
        custom_error_message="expected [x, y, z] in metres, {offset: [x, y, z]}, {over: foot}, or "
        "start",
    ),
]

DirectionTarget = Annotated[
    Annotated[Point, LIST] | Annotated[Start, START],
    forms("a direction [x, y, z], or start"),
]


def _rotation_form(value: object) -> str | None:
    if value == "start":
        return START.tag
    keys = value if isinstance(value, dict) else getattr(type(value), "model_fields", ())
    return next((f"({key})" for key in ("rpy", "quaternion") if key in keys), None)


RotationTarget = Annotated[
    Annotated[Rpy, Tag("(rpy)")]
    | Annotated[QuaternionTarget, Tag("(quaternion)")]
    | Annotated[Start, START],
    Discriminator(
        _rotation_form,
        custom_error_type="form",
        custom_error_message="expected {rpy: [roll, pitch, yaw]} in radians, "
        "{quaternion: [x, y, z, w]}, or start",
    ),
]


class PlacementTarget(Section):
    """Position and orientation of a frame."""

    position: PointTarget = "start"
    """Where its origin should be [m], world axes."""
    orientation: RotationTarget = "start"
    """How it should be turned."""


PoseTarget = Annotated[
    Annotated[PlacementTarget, MAPPING] | Annotated[Start, START],
    forms("{position: ..., orientation: ...}, or start"),
]

_Row = Annotated[tuple[Number, ...], Strict(False), Field(min_length=3, max_length=3)]

InertiaTarget = Annotated[
    Annotated[Number, NUMBER]
    | Annotated[tuple[Number, ...], Strict(False), Field(min_length=3, max_length=6), LIST]
    | Annotated[tuple[_Row, ...], Strict(False), Field(min_length=3, max_length=3), MATRIX]
    | Annotated[Scale, MAPPING]
    | Annotated[Start, START],
    forms(
        "numbers in kg m^2 (three diagonal entries or principal moments, six entries xx xy xz yy "
        "yz zz, a 3x3 matrix, or one number for the trace), {scale: factor}, or start"
    ),
]


def _posture_form(value: object) -> str | None:
    return WORD.tag if isinstance(value, str) else form_of(value)


# "start" is a word like the names of postures: as a form of its own it would match twice in the
# JSON Schema.
PostureTarget = Annotated[
    Annotated[dict[Name, Number], MAPPING] | Annotated[Name, WORD],
    Discriminator(
        _posture_form,
        custom_error_type="form",
        custom_error_message="expected the name of a posture, {joint: value}, or start",
    ),
]
