"""Where a pendulum starts: from words of the file to configuration and velocity."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field, Strict
from scipy.spatial.transform import Rotation

from wbc.problem.mistakes import Misplaced
from wbc.problem.section import LIST, NUMBER, NonNegative, Number, Point, Positive, Section, forms
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

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


def planar_start(spec: PendulumStartSpec, model: PlanarRmp) -> tuple[Array, Array]:
    """Return (q, v) of a planar pendulum.

    Raises
    ------
    Misplaced
        What only a solid pendulum has, or neither or both of inertia and radii.
    """
    for name in ("phi", "rpy"):
        if name in spec.model_fields_set:
            raise Misplaced("only a solid pendulum (rmp_solid) has this", "start", name)
    if "phi" in spec.rates.model_fields_set:
        raise Misplaced("only a solid pendulum (rmp_solid) has this", "start", "rates", "phi")
    key, sizes = _masses(spec)
    size = _one(sizes, key)
    r = math.sqrt(size / model.mass) if key == "inertia" else size
    spin = _one(spec.rates.spin, "rates", "spin")
    q = np.array((0.0, spec.theta, spec.leg_length, spec.alpha, r))
    return q, np.array((0.0, spec.rates.theta, spec.rates.leg, spin, 0.0))


def solid_start(spec: PendulumStartSpec, model: SolidRmp) -> tuple[Array, Array]:
    """Return (q, v) of a solid pendulum.

    Raises
    ------
    Misplaced
        What only a planar pendulum has, neither or both of inertia and radii, or moments of inertia
        that no masses have.
    """
    if "alpha" in spec.model_fields_set:
        raise Misplaced("only a planar pendulum has this; a solid one has rpy", "start", "alpha")
    key, sizes = _masses(spec)
    three = _three(sizes, key)
    radii = _radii(three, model.mass) if key == "inertia" else three
    quaternion = Rotation.from_euler("xyz", spec.rpy).as_quat()  # x y z w; about fixed axes
    spin = np.zeros(3) if spec.rates.spin == 0.0 else _three(spec.rates.spin, "rates", "spin")
    q = np.concatenate(((0.0, 0.0, spec.theta, spec.phi, spec.leg_length), quaternion, radii))
    rates = (0.0, 0.0, spec.rates.theta, spec.rates.phi, spec.rates.leg)
    return q, np.concatenate((rates, spin, np.zeros(3)))


def _masses(spec: PendulumStartSpec) -> tuple[str, float | tuple[float, ...]]:
    given = {"inertia": spec.inertia, "radii": spec.radii}
    found = {key: value for key, value in given.items() if value is not None}
    if len(found) != 1:
        raise Misplaced("give inertia or radii, and only one of them", "start")
    return next(iter(found.items()))


def _one(value: float | tuple[float, ...], *where: str) -> float:
    if isinstance(value, tuple):
        raise Misplaced("a planar pendulum needs one number here", "start", *where)
    return float(value)


def _three(value: float | tuple[float, ...], *where: str) -> Array:
    if not isinstance(value, tuple):
        raise Misplaced("a solid pendulum needs three numbers here", "start", *where)
    return np.array(value)


def _radii(moments: Array, mass: float) -> Array:
    """Return r_k (3,) with (M/3) (r_i^2 + r_j^2) the moments of inertia (3,)."""
    squares = 3.0 * (0.5 * moments.sum() - moments) / mass
    if squares.min() < 0.0:
        k = int(squares.argmin())
        raise Misplaced(
            f"no mass has these moments: {moments[k]:g} is more than the sum of the other two",
            "start",
            "inertia",
        )
    return np.asarray(np.sqrt(squares))
