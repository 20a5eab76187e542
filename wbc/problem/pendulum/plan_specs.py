"""A pendulum's plan as a problem file describes it: states, contact phases, limits, weights."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Strict

from wbc.problem.section import (
    LIST,
    MAPPING,
    MATRIX,
    NUMBER,
    WORD,
    Name,
    NonNegative,
    Number,
    Pair,
    Positive,
    PositiveOrInfinite,
    Range,
    Section,
    forms,
)

_Sizes = Annotated[tuple[Positive, ...], Strict(False), Field(min_length=2, max_length=2)]
_Parts = Annotated[tuple[Number | None, ...], Strict(False), Field(min_length=3, max_length=3)]
_Durations = Annotated[
    Annotated[Positive, NUMBER] | Annotated[_Sizes, LIST],
    forms("seconds, or [least, greatest]"),
]


class RectangleSpec(Section):
    """A rectangular sole on the ground, its sides along x and y."""

    at: Pair
    """Middle [x, y] [m]."""
    size: _Sizes
    """Length along x and width along y [m]."""


class HullSpec(Section):
    """The convex hull of several soles."""

    hull: Annotated[tuple[RectangleSpec, ...], Strict(False), Field(min_length=1)]
    """The soles."""


SupportPolygon = Annotated[
    Annotated[Literal["flight"], WORD]
    | Annotated[tuple[Pair, ...], Strict(False), Field(min_length=1), MATRIX]
    | Annotated[RectangleSpec | HullSpec, MAPPING],
    forms(
        "flight, corners [[x, y], ...] anticlockwise, {at: [x, y], size: [length, width]}, or "
        "{hull: [...]} of several"
    ),
]


class StateSpec(Section):
    """Components of a pendulum's state; null, or what is left out, is free."""

    com: _Parts | None = None
    """Position of the CoM [m]."""
    com_velocity: _Parts | None = None
    """Velocity of the CoM [m/s]."""
    rotation: _Parts | None = None
    """Orientation of the masses as a rotation vector from the plan's reference [rad]."""
    momentum: _Parts | None = None
    """Angular momentum about the CoM [kg m^2/s], world axes."""
    radii: _Parts | None = None
    """Distances of the masses from the CoM [m]."""
    radii_rates: _Parts | None = None
    """Their rates [m/s]."""
    inertia: _Parts | None = None
    """Principal moments of inertia [kg m^2], in place of radii."""


class PlanLimitsSpec(Section):
    """What the pendulum may do at every moment of a phase."""

    friction: PositiveOrInfinite | None = None
    """Largest horizontal over vertical ground force."""
    torsion: NonNegative | None = None
    """Largest moment about the vertical over the vertical ground force [m]."""
    normal_force: Range | None = None
    """[least, greatest] vertical ground force in stance [N]."""
    force: PositiveOrInfinite | None = None
    """Greatest ground force [N]."""
    leg_length: Range | None = None
    """[least, greatest] distance from CoP to CoM [m]."""
    torque: PositiveOrInfinite | None = None
    """Greatest torque between leg and masses [N m]."""
    momentum: PositiveOrInfinite | None = None
    """Greatest size of each component of the angular momentum [kg m^2/s]."""
    radius: Range | None = None
    """[least, greatest] distance of the masses [m]."""
    radius_rate: PositiveOrInfinite | None = None
    """Greatest rate of a distance [m/s]."""
    radius_acceleration: PositiveOrInfinite | None = None
    """Greatest acceleration of a distance [m/s^2]."""
    height: Range | None = None
    """[least, greatest] height of the CoM [m]."""


class PlanPhaseSpec(Section):
    """A phase of the schedule: on one support, or in flight."""

    duration: _Durations
    """How long it lasts [s], or [least, greatest] to choose from."""
    support: SupportPolygon
    """Where the ground may push, or flight."""
    intervals: Annotated[int, Field(ge=1, le=1000)] = 10
    """Number of intervals of the collocation."""
    limits: PlanLimitsSpec = PlanLimitsSpec()
    """What differs from the plan's limits in this phase."""
    end: StateSpec = StateSpec()
    """Components of the state that are given where the phase ends."""


class PlanWeightsSpec(Section):
    """Weights of the cost; each on the square of a quantity, integrated over time."""

    force_rate: NonNegative = 1e-4
    """On the ground force's rate over the mass."""
    acceleration: NonNegative = 0.1
    """On the CoM's acceleration."""
    momentum: NonNegative = 10.0
    """On the angular momentum over the mass."""
    torque: NonNegative = 0.1
    """On its rate over the mass."""
    cop_rate: NonNegative = 0.1
    """On the rate of the CoP."""
    moment: NonNegative = 1.0
    """On the moment of friction about the vertical over the mass."""
    radius_acceleration: NonNegative = 1e-2
    """On the acceleration of the masses' distances."""
    com: NonNegative = 1.0
    """On the way of the CoM from the nominal one."""
    radii: NonNegative = 1.0
    """On the difference of the radii from the nominal ones."""
    rotation: NonNegative = 1.0
    """On the rotation from the nominal one."""
    time: NonNegative = 0.0
    """On the duration itself, not squared."""


class PlanSpec(Section):
    """A motion to be planned by direct collocation."""

    schedule: Annotated[dict[Name, PlanPhaseSpec], Field(min_length=1)]
    """Phases by name, in order of time."""
    start: StateSpec
    """What is given of the first state."""
    goal: StateSpec = StateSpec()
    """What is given of the last state."""
    nominal: StateSpec = StateSpec()
    """What the cost draws to."""
    limits: PlanLimitsSpec = PlanLimitsSpec()
    """For all phases; a phase's own come on top."""
    weights: PlanWeightsSpec = PlanWeightsSpec()
    """Of the cost."""
    periodic: Pair | None = None
    """Stride [x, y] [m]: the last state is the first one moved by it."""
    reference: (
        Annotated[tuple[Number, ...], Strict(False), Field(min_length=4, max_length=4)] | None
    ) = None
    """Orientation that rotations are counted from, a unit quaternion (x, y, z, w)."""
    degree: Annotated[int, Field(ge=2, le=7)] = 4
    """Degree of the orientation's polynomial in each interval."""
    iterations: Annotated[int, Field(ge=1, le=100_000)] = 100
    """The most that IPOPT may take."""
