"""Bounds, laws and pushes of a pendulum as a problem file describes them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Strict

from wbc.problem.section import (
    LIST,
    MATRIX,
    NonNegative,
    Number,
    OneOf,
    Pair,
    Positive,
    PositiveOrInfinite,
    Range,
    Section,
    forms,
)

_Numbers = Annotated[tuple[Positive, ...], Strict(False), Field(min_length=1)]
_Impulse = Annotated[tuple[Number, ...], Strict(False), Field(min_length=2, max_length=3)]


class BoundsSpec(Section):
    """What the pendulum may do; the law respects it and the simulation judges by it."""

    polygon: (
        Annotated[
            Annotated[Pair, LIST]
            | Annotated[tuple[Pair, ...], Strict(False), Field(min_length=3), MATRIX],
            forms("[least x, greatest x] (planar), or corners [[x, y], ...] (solid)"),
        ]
        | None
    ) = None
    """Support on the ground [m]: [least x, greatest x] (planar) or corners anticlockwise (solid);
    left out: a point."""
    friction: PositiveOrInfinite | None = None
    """Largest horizontal over vertical ground force."""
    leg_force: Range | None = None
    """[least, greatest] force along the leg [N]."""
    leg_length: Range | None = None
    """[least, greatest] length of the leg [m]."""
    wheel_torque: PositiveOrInfinite | None = None
    """Greatest torque about each axis of the masses [N m]."""
    wheel_angle: PositiveOrInfinite | None = None
    """Greatest angle of the masses about each axis [rad]."""
    wheel_rate: PositiveOrInfinite | None = None
    """Greatest rate of that angle [rad/s]."""
    radius: Range | None = None
    """[least, greatest] distance of the masses from the CoM [m]."""


class StaticLeanSpec(Section):
    """Planar: the leg stays beyond its foot as long as the wheel can gain speed (paper 4.2)."""

    type: Literal["static_lean"]
    angle: Annotated[float, Field(gt=0, lt=3.141592653589793)]
    """theta to hold [rad]; pi/2 is upright."""
    rate: Positive = 10.0
    """Rate at which errors decay [1/s]."""


class LqrSpec(Section):
    """Linear quadratic regulator about the upright at the start's leg length and radii."""

    type: Literal["lqr"]
    foot: bool = False
    """Whether the foot may give torque; then bounds.polygon is needed."""
    errors: _Numbers | None = None
    """Largest states wanted (Bryson's rule); see wbc.rmp.balance.lqr for their order."""
    efforts: _Numbers | None = None
    """Largest inputs wanted."""


class SwingUpSpec(Section):
    """Planar: from hanging to upright and held there, the foot bolted to a pivot."""

    type: Literal["swing_up"]


class SpinSpec(Section):
    """Masses drawn in or out until they spin as wanted, without any torque."""

    type: Literal["spin"]
    spin: Number
    """Wanted rate of the masses in space [rad/s]."""
    within: Positive = 1.0
    """Duration of the change [s]."""
    rate: Positive = 20.0
    """Rate at which errors decay [1/s]."""


class MomentumQpSpec(Section):
    """Solid, on a flat foot: capture point and momentum by one quadratic program per tick."""

    type: Literal["momentum_qp"]
    com: Annotated[tuple[Number, ...], Strict(False), Field(min_length=3, max_length=3)] | None = (
        None
    )
    """Where the CoM rests [m]; left out: above the leg's foot at the start's leg length."""


class StabiliserSpec(Section):
    """Solid, on a contact without extent: leg and masses brought to rest by the hip alone."""

    type: Literal["stabiliser"]


LawChoice = Annotated[
    StaticLeanSpec | LqrSpec | SwingUpSpec | SpinSpec | MomentumQpSpec | StabiliserSpec,
    OneOf("type", "{type: lqr}"),
]


class PushSpec(Section):
    """A blow to the CoM: its velocity jumps."""

    time: NonNegative
    """When [s]."""
    impulse: _Impulse
    """[N s], up last: [x, z] (planar) or [x, y, z] (solid)."""


class PlantSpec(Section):
    """A pendulum that is not quite what the law believes."""

    mass: Positive = 1.0
    """Factor on the mass; the masses' distances stay, so the inertia is scaled too."""


class AcceptSpec(Section):
    """What must hold at the end of a simulation, besides the bounds on the way."""

    leg: Positive | None = None
    """Angle of the leg from where it should be [rad]."""
    leg_rate: Positive | None = None
    """Its rate [rad/s]."""
    wheel_rate: Positive | None = None
    """Rate of the masses: relative to the leg (planar), in space (solid) [rad/s]."""
    spin: Positive | None = None
    """Difference of the masses' spin from the one wanted by a spin law [rad/s]."""
    worst_leg: Positive | None = None
    """Largest angle of the leg from where it should be, at any time [rad]."""


class PendulumStopSpec(Section):
    """How long a simulation runs, and what counts as success.

    Success is to stand until then, within bounds, and accept.
    """

    duration: Positive = 5.0
    """Time to simulate [s]."""
    dt: Annotated[float, Field(allow_inf_nan=False, ge=1e-6, le=0.1)] = 1e-3
    """Time between commands [s]."""
    accept: AcceptSpec = AcceptSpec()
    """Tolerances."""
