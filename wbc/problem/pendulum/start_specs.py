"""Where a pendulum starts, as a problem file describes it."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, Strict

from wbc.problem.section import LIST, NUMBER, NonNegative, Number, Point, Positive, Section, forms

_Three = Annotated[tuple[NonNegative, ...], Strict(False), Field(min_length=3, max_length=3)]
_OneOrThree = Annotated[
    Annotated[NonNegative, NUMBER] | Annotated[_Three, LIST],
    forms("one number, or three for a solid pendulum"),
]
_Spin = Annotated[Annotated[Number, NUMBER] | Annotated[Point, LIST], forms("a rate, or three")]


class RatesSpec(Section):
    """How fast a pendulum moves at the start."""

    theta: Number = 0.0
    """Rate of the leg's angle theta [rad/s]."""
    phi: Number = 0.0
    """Rate of the leg's angle phi [rad/s]; solid only."""
    leg: Number = 0.0
    """Rate of the leg's length [m/s]."""
    spin: _Spin = 0.0
    """Planar: rate of alpha, the masses relative to the leg [rad/s]. Solid: body rate of the masses
    (3) [rad/s]."""


class PendulumStartSpec(Section):
    """Where a pendulum starts; upright and at rest unless said otherwise."""

    leg_length: Positive
    """Length of the leg [m]."""
    inertia: _OneOrThree | None = None
    """Moment of inertia of the masses [kg m^2]: planar one number, solid three about their axes.
    This or radii."""
    radii: _OneOrThree | None = None
    """Distance of the masses from the CoM [m]: planar one number, solid three. This or inertia."""
    theta: Number = math.pi / 2
    """Angle of the leg from the x axis upward [rad]: pi/2 is upright, -pi/2 hangs."""
    phi: Number = 0.0
    """Angle of the leg out of the x-z plane toward y [rad]; solid only."""
    alpha: Number = 0.0
    """Angle of the masses relative to the leg [rad]; planar only."""
    rpy: Point = (0.0, 0.0, 0.0)
    """Orientation of the masses, roll, pitch, yaw [rad]; solid only."""
    rates: RatesSpec = RatesSpec()
    """How fast it moves."""
