"""The format of a pendulum's problem file: a law to simulate, or a motion to plan.

Where it starts is made configuration and velocity.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.problem.mistakes import Misplaced
from wbc.problem.pendulum.laws import LawChoice
from wbc.problem.pendulum.plan import PlanSpec
from wbc.problem.robot_spec import RobotChoice
from wbc.problem.section import (
    Forms,
    KeysOf,
    ListOf,
    Name,
    NonNegative,
    Number,
    Pair,
    Point,
    Positive,
    Section,
    Size,
    Three,
)
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.plan import radii_for
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.spatial import STANDARD_GRAVITY
from wbc.validate import Array

_OneOrThree = Annotated[
    NonNegative | Three[NonNegative], Forms("one number, or three for a solid pendulum")
]
_Spin = Annotated[Number | Point, Forms("a rate, or three")]
_Polygon = Annotated[
    Pair | Annotated[ListOf[Pair], Field(min_length=3)],
    Forms("[least x, greatest x] (planar), or corners [[x, y], ...] (solid)"),
]


class RatesSpec(Section):
    """Initial rates of a pendulum."""

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
    """Initial state of a pendulum; upright and at rest by default."""

    leg_length: Size
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
    """Initial rates."""

    def state(self, model: PlanarRmp | SolidRmp) -> tuple[Array, Array]:
        """Return (q, v) of a pendulum.

        Raises Misplaced: a key of the other kind of pendulum, neither or both of inertia and radii,
        or moments of inertia that no masses can have.
        """
        given = {"inertia": self.inertia, "radii": self.radii}
        found = {key: value for key, value in given.items() if value is not None}
        if len(found) != 1:
            raise Misplaced("give inertia or radii, and only one of them")
        ((key, sizes),) = found.items()
        if isinstance(model, PlanarRmp):
            return self._planar(model, key, sizes)
        return self._solid(model, key, sizes)

    def _planar(
        self, model: PlanarRmp, key: str, sizes: float | tuple[float, ...]
    ) -> tuple[Array, Array]:
        for name in sorted({"phi", "rpy"} & self.model_fields_set):
            raise Misplaced("only a solid pendulum (rmp_solid) has this", name)
        if "phi" in self.rates.model_fields_set:
            raise Misplaced("only a solid pendulum (rmp_solid) has this", "rates", "phi")
        size = _one(sizes, key)
        r = math.sqrt(size / model.mass) if key == "inertia" else size
        spin = _one(self.rates.spin, "rates", "spin")
        q = np.array((0.0, self.theta, self.leg_length, self.alpha, r))
        return q, np.array((0.0, self.rates.theta, self.rates.leg, spin, 0.0))

    def _solid(
        self, model: SolidRmp, key: str, sizes: float | tuple[float, ...]
    ) -> tuple[Array, Array]:
        if "alpha" in self.model_fields_set:
            raise Misplaced("only a planar pendulum has this; a solid one has rpy", "alpha")
        three = _three(sizes, key)
        radii = _radii(three, model.mass) if key == "inertia" else three
        quaternion = Rotation.from_euler("xyz", self.rpy).as_quat()  # x y z w; about fixed axes
        rates = self.rates
        spin = np.zeros(3) if rates.spin == 0.0 else _three(rates.spin, "rates", "spin")
        q = np.concatenate(((0.0, 0.0, self.theta, self.phi, self.leg_length), quaternion, radii))
        leg = (0.0, 0.0, rates.theta, rates.phi, rates.leg)
        return q, np.concatenate((leg, spin, np.zeros(3)))


class BlowSpec(Section):
    """An impulse on the CoM, whose velocity jumps."""

    time: NonNegative
    """Time of the impulse [s]."""
    impulse: Annotated[ListOf[Number], Field(min_length=2, max_length=3)]
    """[N s], up last: [x, z] (planar) or [x, y, z] (solid)."""


class PlantSpec(Section):
    """How the simulated pendulum differs from the law's model."""

    mass: Positive = 1.0
    """Factor on the mass; the masses' distances stay, so the inertia is scaled too."""


class AcceptSpec(Section):
    """Tolerances at the end of a simulation; the bounds apply at all times."""

    leg: Positive | None = None
    """Angle of the leg from its target [rad]."""
    leg_rate: Positive | None = None
    """Its rate [rad/s]."""
    wheel_rate: Positive | None = None
    """Rate of the masses: relative to the leg (planar), in space (solid) [rad/s]."""
    spin: Positive | None = None
    """Difference of the masses' spin from a spin law's target [rad/s]."""
    worst_leg: Positive | None = None
    """Largest angle of the leg from its target, at any time [rad]."""


class PendulumStopSpec(Section):
    """Duration of a simulation, and the criteria of success.

    Success is to stand until the end, within the bounds, and to meet the tolerances of accept.
    """

    duration: Positive = 5.0
    """Time to simulate [s]."""
    dt: Annotated[float, Field(allow_inf_nan=False, ge=1e-6, le=0.1)] = 1e-3
    """Time between commands [s]."""
    accept: AcceptSpec = AcceptSpec()
    """Tolerances."""


class PendulumSpec(Section):
    """A reaction mass pendulum under a balance law, or with a motion to plan."""

    version: Literal[1] = 1
    """Version of this format."""
    model: Literal["rmp_planar", "rmp_solid"]
    """The model of the pendulum."""
    mass: Size | None = None
    """Total mass [kg]; with robot, left out: it is the robot's."""
    robot: RobotChoice | None = None
    """The humanoid to plan for, which gives mass, initial state at rest and soles. A name that `wbc
    robots` lists, a .urdf or .xml file relative to this file, or a mapping."""
    posture: Name = "standing"
    """The robot's posture at the start of the plan."""
    gravity: NonNegative = STANDARD_GRAVITY
    """[m/s^2], downward."""
    start: PendulumStartSpec | None = None
    """Initial state, with a law."""
    bounds: Annotated[dict[str, Any], KeysOf(LawBounds, polygon=_Polygon, torsion=bool)] = Field(
        default_factory=dict
    )
    """Bounds that a law respects, and by which the simulation is judged."""
    law: LawChoice | None = None
    """The balance law to simulate; this or plan."""
    pushes: ListOf[BlowSpec] = ()
    """Impulses on the CoM, with a law."""
    plant: PlantSpec = PlantSpec()
    """The simulated pendulum, where it differs from the law's model."""
    stop: PendulumStopSpec = PendulumStopSpec()
    """End of the simulation, and criteria of success."""
    plan: PlanSpec | None = None
    """The motion to plan; this or law."""


def _one(value: float | tuple[float, ...], *where: str) -> float:
    if isinstance(value, tuple):
        raise Misplaced("a planar pendulum needs one number here", *where)
    return float(value)


def _three(value: float | tuple[float, ...], *where: str) -> Array:
    if not isinstance(value, tuple):
        raise Misplaced("a solid pendulum needs three numbers here", *where)
    return np.array(value)


def _radii(moments: Array, mass: float) -> Array:
    try:
        return radii_for(mass, moments.tolist())
    except InvalidInputError as error:
        raise Misplaced(str(error).removeprefix("inertia: "), "inertia") from error
