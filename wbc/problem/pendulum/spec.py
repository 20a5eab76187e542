"""A pendulum's problem as its file describes it: a law to simulate, or a motion to plan."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Strict

from wbc.problem.pendulum.law_specs import (
    BoundsSpec,
    LawChoice,
    PendulumStopSpec,
    PlantSpec,
    PushSpec,
)
from wbc.problem.pendulum.plan_specs import PlanSpec
from wbc.problem.pendulum.start_specs import PendulumStartSpec
from wbc.problem.section import NonNegative, Positive, Section


class PendulumSpec(Section):
    """A reaction mass pendulum under a balance law, or with a motion to plan."""

    version: Literal[1] = 1
    """Version of this format."""
    model: Literal["rmp_planar", "rmp_solid"]
    """Which pendulum."""
    mass: Positive
    """All of its mass [kg]."""
    gravity: NonNegative = 9.81
    """[m/s^2], downward."""
    start: PendulumStartSpec | None = None
    """Where it starts, under a law."""
    bounds: BoundsSpec = BoundsSpec()
    """What it may do, under a law."""
    law: LawChoice | None = None
    """The balance law to simulate; this or plan."""
    pushes: Annotated[tuple[PushSpec, ...], Strict(False)] = ()
    """Blows to the CoM, under a law."""
    plant: PlantSpec = PlantSpec()
    """What moves instead of the pendulum that the law believes in."""
    stop: PendulumStopSpec = PendulumStopSpec()
    """When the simulation ends, and what counts as success."""
    plan: PlanSpec | None = None
    """The motion to plan; this or law."""
