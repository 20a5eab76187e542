"""The support section of a problem file, and the contacts made from it."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from wbc.constraints import Contact, LineContact, PointContact, support
from wbc.constraints.contact import DEFAULT_FRICTION
from wbc.constraints.friction import MOST_FACETS, FrictionCone
from wbc.constraints.sole_contacts import default_contact
from wbc.constraints.support_modes import base_contact, feet_of, sole_or_frame
from wbc.errors import InvalidInputError
from wbc.problem.mistakes import Misplaced
from wbc.problem.section import (
    Forms,
    ListOf,
    Name,
    NonEmpty,
    NonNegative,
    Number,
    Positive,
    Section,
    default_of,
)
from wbc.robot import Robot, Snapshot
from wbc.robot.names import BASE
from wbc.run.phase_support import off_the_ground

# Largest distance of the corners of standing soles from the ground at the start [m].
GROUND_TOLERANCE = 0.02


class FrictionSpec(Section):
    """A friction cone, linearised to a pyramid."""

    coefficient: Positive = default_of(FrictionCone, "coefficient")
    """Friction coefficient: tangential force over normal force."""
    facets: Annotated[int, Field(ge=3, le=MOST_FACETS)] = default_of(FrictionCone, "facets")
    """Sides of the pyramid."""
    inner: bool = default_of(FrictionCone, "inner")
    """Whether the pyramid is inscribed in the cone, which is safe, or circumscribed."""
    least: NonNegative = default_of(FrictionCone, "least")
    """Normal force that the contact should have at least [N]; gives way where it cannot be had."""
    most: Positive | None = None
    """Largest normal force [N]; left out: any."""

    @field_validator("most")
    @classmethod
    def _above_least(cls, most: float | None, info: ValidationInfo) -> float | None:
        least = info.data.get("least")
        if most is not None and least is not None and most < least:
            raise PydanticCustomError("range", "must not be below least")
        return most


Friction = Annotated[
    Positive | FrictionSpec, Forms("a coefficient, or {coefficient: ..., facets: ...}")
]


def cone(friction: float | FrictionSpec) -> FrictionCone:
    """Return the cone of a coefficient or a mapping."""
    if isinstance(friction, FrictionSpec):
        return FrictionCone(**friction.model_dump(exclude_none=True))
    return FrictionCone(friction)


class ContactSpec(Section):
    """A frame that is held where it is at the start."""

    frame: Name
    """A foot, link, sole or other frame of the robot."""
    type: Literal["fixed", "point", "line"] | None = None
    """fixed: position and orientation are held; point: the position only; line: all but the turn
    about the line of its corners, or of the sole's length; left out: point or line for the sole of
    a foot that ends in one, else fixed."""
    gain: Annotated[float, Field(allow_inf_nan=False, ge=0, le=1)] = 0.5
    """Fraction of the drift to take back in one tick, in [0, 1]."""
    kp: NonNegative | None = None
    """At the torque level, instead of gain: stiffness of the drift [1/s^2]; left out: 100."""
    kd: NonNegative | None = None
    """At the torque level: damping [1/s]; left out: critical."""
    friction: (
        Annotated[
            Positive | FrictionSpec | Literal["grip"],
            Forms("a coefficient, {coefficient: ..., facets: ...}, or grip"),
        ]
        | None
    ) = None
    """What it bears, at the torque level; grip: it pulls and twists as well; left out: as in the
    controller's section."""
    corners: NonEmpty[Annotated[ListOf[Number], Field(min_length=2, max_length=3)]] | None = None
    """Points [x, y] or [x, y, z] in the frame's axes where its forces act [m], at the torque level;
    left out: those of the sole that the frame is."""
    slack: Positive | None = None
    """Weight of the squared slip [1/(m/s)^2, 1/(rad/s)^2] of a contact that may give way; left out:
    hard."""

    def settings(self, friction: FrictionCone) -> dict[str, Any]:
        """Return keywords of the contact; ``friction`` is that of contacts without their own."""
        values = {key: getattr(self, key) for key in ("gain", "kp", "kd", "corners")}
        own = self.friction
        values["friction"] = friction if own is None else None if own == "grip" else cone(own)
        return {
            key: value for key, value in values.items() if value is not None or key == "friction"
        }


Support = Annotated[
    Literal["floating", "left", "right", "double", "all"]
    | NonEmpty[
        Annotated[
            Name | ContactSpec,
            Forms("the name of a foot or frame, or {frame: ..., type: fixed, point or line}"),
        ]
    ],
    Forms("floating, left, right, double, all, or a list of feet and frames"),
]


def contacts_of(
    spec: Support | None, snapshot: Snapshot, friction: FrictionCone = DEFAULT_FRICTION
) -> tuple[Contact, ...]:
    """Return the contacts of a problem's support, anchored at the snapshot; None is floating.

    ``friction``: of contacts without their own.

    Raises UnknownNameError: no such foot or frame; Misplaced: a frame named twice.
    """
    if spec is None or isinstance(spec, str):
        return support(snapshot, spec or "floating", friction=friction)
    robot = snapshot.robot
    wanted = [ContactSpec(frame=one) if isinstance(one, str) else one for one in spec]
    frames = [sole_or_frame(robot, one.frame) for one in wanted]
    for k, frame in enumerate(frames):
        if frame in frames[:k]:
            raise Misplaced(f"frame {frame!r} is named twice", k)
    kinds = {"fixed": Contact, "point": PointContact, "line": LineContact}
    held = (
        (kinds[one.type] if one.type else default_contact(robot, frame)).hold(
            snapshot, frame, **one.settings(DEFAULT_FRICTION if frame == BASE else friction)
        )
        for one, frame in zip(wanted, frames, strict=True)
    )
    return base_contact(snapshot) + tuple(held)


def check_support_given(spec: Support | None, robot: Robot) -> None:
    """Refuse a missing support of a robot with feet."""
    if spec is None and robot.feet:
        words = "left, right, double" if {"left", "right"} <= robot.feet.keys() else "all"
        feet = ", ".join(robot.feet)
        raise InvalidInputError(
            f"say what the robot stands on: write support: {words}, a list of feet and frames such "
            f"as [{feet}], or floating (nothing is held)"
        )


def check_feet_on_ground(
    spec: Support | None, snapshot: Snapshot, slope: Sequence[float] = (0.0, 0.0)
) -> None:
    """Refuse a support mode whose feet are not on one plane, of the given rise over run (2,)."""
    if not isinstance(spec, str) or spec == "floating":
        return
    feet = feet_of(snapshot.robot, spec)
    soles = [snapshot.robot.feet[name] for name in feet]
    upright = np.array((-slope[0], -slope[1], 1.0))
    lowest = min(
        float((one.polygon @ (upright @ snapshot.rotation(one.frame))[:2]).min())
        + float(upright @ snapshot.position(one.frame))
        for one in soles
    )
    for name in feet:
        why = off_the_ground(
            snapshot, name, lambda places: lowest - places @ upright[:2], GROUND_TOLERANCE
        )
        if why:
            frames = ", ".join(one.frame for one in soles)
            raise InvalidInputError(
                f"{why}; change start.joints (hip, knee, ankle), or list the frames that are to be"
                f" held where they are: support: [{frames}]"
            )


def tell_below_ground(contacts: Iterable[Contact], start: Snapshot) -> None:
    """Warn of contacts below the ground: hands of a handstand whose soles are put on it."""
    depths = {one.frame: -float(start.position(one.frame)[2]) for one in contacts}
    deep = {frame: depth for frame, depth in depths.items() if depth > GROUND_TOLERANCE}
    if deep and start.robot.feet and not start.robot.fixed_base:
        frame = max(deep, key=lambda one: deep[one])
        logging.getLogger(__name__).warning(
            "support: %s begins %.3g m below the ground, z = 0, where the lowest sole is put;"
            " start: {on_ground: false} leaves the base where the posture has it",
            frame,
            deep[frame],
        )


def slack_by_frame(robot: Robot, supports: Iterable[Support | None]) -> dict[str, float]:
    """Return the slack weights of contacts, by frame; later supports override earlier ones."""
    listed = (one for support in supports if not isinstance(support, str) for one in support or ())
    return {
        sole_or_frame(robot, one.frame): one.slack
        for one in listed
        if isinstance(one, ContactSpec) and one.slack is not None
    }
