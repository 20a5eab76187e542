"""A pendulum's problem as its file describes it: a law to simulate, or a motion to plan."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from wbc.problem.pendulum.laws import LawChoice
from wbc.problem.pendulum.plan import PlanSpec
from wbc.problem.pendulum.start import PendulumStartSpec
from wbc.problem.robot_spec import RobotChoice
from wbc.problem.section import (
    Forms,
    KeysOf,
    ListOf,
    Name,
    NonNegative,
    Number,
    Pair,
    Positive,
    Section,
    Size,
)
from wbc.rmp.balance.law import LawBounds
from wbc.spatial import STANDARD_GRAVITY

_Polygon = Annotated[
    Pair | Annotated[ListOf[Pair], Field(min_length=3)],
    Forms("[least x, greatest x] (planar), or corners [[x, y], ...] (solid)"),
]


class BlowSpec(Section):
    """A blow to the CoM: its velocity jumps."""

    time: NonNegative
    """When [s]."""
    impulse: Annotated[ListOf[Number], Field(min_length=2, max_length=3)]
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


class PendulumSpec(Section):
    """A reaction mass pendulum under a balance law, or with a motion to plan."""

    version: Literal[1] = 1
    """Version of this format."""
    model: Literal["rmp_planar", "rmp_solid"]
    """Which pendulum."""
    mass: Size | None = None
    """All of its mass [kg]; that of the robot if there is one."""
    robot: RobotChoice | None = None
    """The humanoid that the plan is for: its mass, its start at rest, its soles. A name that
    `wbc robots` lists, a .urdf or .xml file relative to this file, or a mapping."""
    posture: Name = "standing"
    """The robot's posture in which the plan begins."""
    gravity: NonNegative = STANDARD_GRAVITY
    """[m/s^2], downward."""
    start: PendulumStartSpec | None = None
    """Where it starts, under a law."""
    bounds: Annotated[dict[str, Any], KeysOf(LawBounds, polygon=_Polygon, torsion=bool)] = Field(
        default_factory=dict
    )
    """What it may do, under a law, which respects it; the simulation judges by it."""
    law: LawChoice | None = None
    """The balance law to simulate; this or plan."""
    pushes: ListOf[BlowSpec] = ()
    """Blows to the CoM, under a law."""
    plant: PlantSpec = PlantSpec()
    """What moves instead of the pendulum that the law believes in."""
    stop: PendulumStopSpec = PendulumStopSpec()
    """When the simulation ends, and what counts as success."""
    plan: PlanSpec | None = None
    """The motion to plan; this or law."""
