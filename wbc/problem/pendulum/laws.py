"""Balance laws in problem files: the keys of each, and how to build it.

To add a law, write it in a file of its own, and add a :class:`LawSpec` here.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from wbc.problem.section import NonEmpty, Number, OneOf, Point, Positive, Section
from wbc.rmp.balance.law import BalanceLaw, LawBounds
from wbc.rmp.balance.lqr import Lqr
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.spin_change import SpinChange
from wbc.rmp.balance.stabiliser import PointStabiliser
from wbc.rmp.balance.static_lean import StaticLean
from wbc.rmp.balance.swing_up import SwingUp
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Setting:
    """The pendulum, bounds, initial state and time step that a law is built for."""

    pendulum: Any  # a PlanarRmp or a SolidRmp
    bounds: LawBounds
    q: Array  # (nq,) at the start
    v: Array  # (nv,) at the start
    dt: float  # time between commands [s]

    @property
    def lengths(self) -> tuple[float, Any]:
        """Length of the leg and distances of the masses at the start [m], one or three."""
        if isinstance(self.pendulum, PlanarRmp):
            return float(self.q[2]), float(self.q[4])
        return float(self.q[4]), self.q[9:]


class LawSpec(Section):
    """The base of every law's description."""

    needs: ClassVar[Literal["rmp_planar", "rmp_solid"] | None] = None  # the only model it supports
    pivot: ClassVar[bool] = False  # whether the foot is bolted to a pivot, which pulls as well

    type: str

    @abstractmethod
    def build(self, on: Setting) -> BalanceLaw:
        """Return the law; it raises InvalidInputError for numbers that it refuses."""

    def leg(self, on: Setting) -> Array:
        """Return the direction (3,) in which the leg should point, from foot to CoM."""
        return np.array((0.0, 0.0, 1.0))

    def measures(self, law: Any, v: Array) -> dict[str, float]:
        """Return the measures that only this law has, from the final velocity (nv,)."""
        return {}


class StaticLeanSpec(LawSpec):
    """Planar: the leg stays beyond its foot as long as the wheel can gain speed (paper 4.2)."""

    needs = "rmp_planar"
    type: Literal["static_lean"]
    angle: Annotated[float, Field(gt=0, lt=math.pi)]
    """theta to hold [rad]; pi/2 is upright."""
    rate: Positive = StaticLean.rate
    """Rate at which errors decay [1/s]."""

    def build(self, on: Setting) -> StaticLean:
        """Return the law."""
        return StaticLean(on.pendulum, self.angle, *on.lengths, on.bounds, self.rate)

    def leg(self, on: Setting) -> Array:
        """Return the direction of ``angle``."""
        return np.array((math.cos(self.angle), 0.0, math.sin(self.angle)))


class LqrSpec(LawSpec):
    """Linear quadratic regulator about the upright at the start's leg length and radii."""

    type: Literal["lqr"]
    foot: bool = Lqr.foot
    """Whether the foot may give torque; then bounds.polygon is needed."""
    errors: NonEmpty[Positive] | None = None
    """Largest acceptable states (Bryson's rule); see wbc.rmp.balance.lqr for their order."""
    efforts: NonEmpty[Positive] | None = None
    """Largest acceptable inputs."""

    def build(self, on: Setting) -> Lqr:
        """Return the law."""
        upright = on.q.copy()
        if isinstance(on.pendulum, SolidRmp):
            upright[2:4], upright[5:9] = (math.pi / 2, 0.0), (0.0, 0.0, 0.0, 1.0)
        else:
            upright[1], upright[3] = math.pi / 2, 0.0
        return Lqr(on.pendulum, upright, self.foot, on.bounds, self.errors, self.efforts)


class SwingUpSpec(LawSpec):
    """Planar: swing up from hanging and balance upright, with the foot bolted to a pivot."""

    needs = "rmp_planar"
    pivot = True
    type: Literal["swing_up"]

    def build(self, on: Setting) -> SwingUp:
        """Return the law."""
        return SwingUp(on.pendulum, *on.lengths, on.bounds, on.dt)


class SpinSpec(LawSpec):
    """Move the masses in or out until they spin at the target rate, without any torque."""

    type: Literal["spin"]
    spin: Number
    """Target rate of the masses in space [rad/s]."""
    within: Positive = 1.0
    """Duration of the change [s]."""
    rate: Positive = SpinChange.rate
    """Rate at which errors decay [1/s]."""

    def build(self, on: Setting) -> SpinChange:
        """Return the law."""
        return SpinChange(on.pendulum, on.q, on.v, self.spin, self.within, on.bounds, self.rate)

    def leg(self, on: Setting) -> Array:
        """Return the initial direction, which does not change."""
        com, _ = on.pendulum.com(on.q, np.zeros(len(on.v)))
        leg = com - (*on.q[: len(com) - 1], 0.0)
        leg = leg if len(leg) == 3 else np.array((leg[0], 0.0, leg[1]))
        return np.asarray(leg / np.linalg.norm(leg))

    def measures(self, law: Any, v: Array) -> dict[str, float]:
        """Return the error of the spin [rad/s]."""
        if isinstance(law.model, PlanarRmp):
            return {"spin": abs(float(v[1] + v[3]) - self.spin)}
        # A body that tumbles has spin about the other axes too.
        return {"spin": float(np.linalg.norm(v[5:8] - self.spin * np.eye(3)[law.axis]))}


class MomentumQpSpec(LawSpec):
    """Solid, on a flat foot: control capture point and momentum with one QP per tick."""

    needs = "rmp_solid"
    type: Literal["momentum_qp"]
    com: Point | None = None
    """Position of the CoM at rest [m]; left out: above the leg's foot at the start's leg length."""

    def build(self, on: Setting) -> MomentumQp:
        """Return the law."""
        return MomentumQp(on.pendulum, on.bounds, self._com(on), on.lengths[1], dt=on.dt)

    def leg(self, on: Setting) -> Array:
        """Return the direction to the CoM at rest."""
        from_foot = self._com(on) - (*on.q[:2], 0.0)
        return np.asarray(from_foot / np.linalg.norm(from_foot))

    def _com(self, on: Setting) -> Array:
        return np.array((0.0, 0.0, on.lengths[0]) if self.com is None else self.com)


class StabiliserSpec(LawSpec):
    """Solid, on a point contact: bring leg and masses to rest by the hip torque alone."""

    needs = "rmp_solid"
    type: Literal["stabiliser"]

    def build(self, on: Setting) -> PointStabiliser:
        """Return the law."""
        return PointStabiliser(on.pendulum, on.bounds, *on.lengths)


LawChoice = Annotated[LawSpec, OneOf("type", "{type: lqr}")]
