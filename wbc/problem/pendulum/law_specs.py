"""Bounds, laws and pushes of a pendulum as a problem file describes them.

A new law is a :class:`LawSpec` here, listed in ``LawChoice``, and its own file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
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

if TYPE_CHECKING:
    from wbc.rmp.balance.law import BalanceLaw, Bounds
    from wbc.validate import Array

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


@dataclass(frozen=True, eq=False)
class LawSetting:
    """What a law is made for: a pendulum, its bounds, its start and the time between commands."""

    pendulum: Any  # a PlanarRmp or a SolidRmp: what the law ``needs``
    bounds: Bounds
    q: Array  # (nq,)
    v: Array  # (nv,)
    dt: float  # s

    def upright(self) -> Array:
        """Return the configuration (nq,) upright with the start's leg length and radii."""
        rest = self.q.copy()
        if len(rest) == 5:
            rest[1], rest[3] = math.pi / 2, 0.0
        else:
            rest[2:4], rest[5:9] = (math.pi / 2, 0.0), (0.0, 0.0, 0.0, 1.0)
        return rest

    def leg(self) -> Array:
        """Return the unit vector (3,) from the foot to the CoM at the start."""
        com, _ = self.pendulum.com(self.q, np.zeros(len(self.v)))
        leg = com - (*self.q[: len(com) - 1], 0.0)
        leg = leg if len(leg) == 3 else np.array((leg[0], 0.0, leg[1]))
        return np.asarray(leg / np.linalg.norm(leg))


class LawSpec(Section):
    """What the kinds of laws have in common."""

    needs: ClassVar[Literal["rmp_planar", "rmp_solid"] | None] = None
    """The only pendulum that the law is for."""
    pivot: ClassVar[bool] = False
    """Whether the foot is bolted to the ground."""

    def build(self, setting: LawSetting) -> BalanceLaw:
        """Return the law; InvalidInputError if it cannot be."""
        raise NotImplementedError

    def goal(self, setting: LawSetting) -> Array:
        """Return the direction (3,) in which the leg should end up, from foot to CoM."""
        return np.array((0.0, 0.0, 1.0))


class StaticLeanSpec(LawSpec):
    """Planar: the leg stays beyond its foot as long as the wheel can gain speed (paper 4.2)."""

    needs = "rmp_planar"
    type: Literal["static_lean"]
    angle: Annotated[float, Field(gt=0, lt=3.141592653589793)]
    """theta to hold [rad]; pi/2 is upright."""
    rate: Positive = 10.0
    """Rate at which errors decay [1/s]."""

    def build(self, setting: LawSetting) -> BalanceLaw:
        """See :meth:`LawSpec.build`."""
        from wbc.rmp.balance.static_lean import StaticLean

        q = setting.q
        return StaticLean(setting.pendulum, self.angle, q[2], q[4], setting.bounds, self.rate)

    def goal(self, setting: LawSetting) -> Array:
        """See :meth:`LawSpec.goal`."""
        return np.array((math.cos(self.angle), 0.0, math.sin(self.angle)))


class LqrSpec(LawSpec):
    """Linear quadratic regulator about the upright at the start's leg length and radii."""

    type: Literal["lqr"]
    foot: bool = False
    """Whether the foot may give torque; then bounds.polygon is needed."""
    errors: _Numbers | None = None
    """Largest states wanted (Bryson's rule); see wbc.rmp.balance.lqr for their order."""
    efforts: _Numbers | None = None
    """Largest inputs wanted."""

    def build(self, setting: LawSetting) -> BalanceLaw:
        """See :meth:`LawSpec.build`."""
        from wbc.rmp.balance.lqr import Lqr

        rest = setting.upright()
        return Lqr(setting.pendulum, rest, self.foot, setting.bounds, self.errors, self.efforts)


class SwingUpSpec(LawSpec):
    """Planar: from hanging to upright and held there, the foot bolted to a pivot."""

    needs = "rmp_planar"
    pivot = True
    type: Literal["swing_up"]

    def build(self, setting: LawSetting) -> BalanceLaw:
        """See :meth:`LawSpec.build`."""
        from wbc.rmp.balance.swing_up import SwingUp

        return SwingUp(setting.pendulum, setting.q[2], setting.q[4], setting.bounds)


class SpinSpec(LawSpec):
    """Masses drawn in or out until they spin as wanted, without any torque."""

    type: Literal["spin"]
    spin: Number
    """Wanted rate of the masses in space [rad/s]."""
    within: Positive = 1.0
    """Duration of the change [s]."""
    rate: Positive = 20.0
    """Rate at which errors decay [1/s]."""

    def build(self, setting: LawSetting) -> BalanceLaw:
        """See :meth:`LawSpec.build`."""
        from wbc.rmp.balance.spin_change import SpinChange

        s = setting
        return SpinChange(s.pendulum, s.q, s.v, self.spin, self.within, s.bounds, self.rate)

    def goal(self, setting: LawSetting) -> Array:
        """Return the direction (3,) that the leg has: the law leaves it."""
        return setting.leg()


class MomentumQpSpec(LawSpec):
    """Solid, on a flat foot: capture point and momentum by one quadratic program per tick."""

    needs = "rmp_solid"
    type: Literal["momentum_qp"]
    com: Annotated[tuple[Number, ...], Strict(False), Field(min_length=3, max_length=3)] | None = (
        None
    )
    """Where the CoM rests [m]; left out: above the leg's foot at the start's leg length."""

    def build(self, setting: LawSetting) -> BalanceLaw:
        """See :meth:`LawSpec.build`."""
        from wbc.rmp.balance.momentum_qp import MomentumQp

        com, radii = self._com(setting), setting.q[9:]
        return MomentumQp(setting.pendulum, setting.bounds, com, radii, dt=setting.dt)

    def goal(self, setting: LawSetting) -> Array:
        """See :meth:`LawSpec.goal`."""
        from_foot = np.asarray(self._com(setting)) - (*setting.q[:2], 0.0)
        return np.asarray(from_foot / np.linalg.norm(from_foot))

    def _com(self, setting: LawSetting) -> tuple[float, ...]:
        return (0.0, 0.0, float(setting.q[4])) if self.com is None else self.com


class StabiliserSpec(LawSpec):
    """Solid, on a contact without extent: leg and masses brought to rest by the hip alone."""

    needs = "rmp_solid"
    type: Literal["stabiliser"]

    def build(self, setting: LawSetting) -> BalanceLaw:
        """See :meth:`LawSpec.build`."""
        from wbc.rmp.balance.stabiliser import PointStabiliser

        q = setting.q
        return PointStabiliser(setting.pendulum, setting.bounds, float(q[4]), q[9:])


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
