"""Rest and momentum: tasks of velocities, which do not depend on the posture alone."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from wbc.problem.section import (
    Distinct,
    Forms,
    ListOf,
    Name,
    NonEmpty,
    NonNegative,
    Number,
    Weight,
    Words,
    default_of,
)
from wbc.problem.targets import Followed, FromMotion, FromPlan, entries
from wbc.problem.task_spec import MotionTaskSpec
from wbc.robot import Snapshot
from wbc.run.ramps import VECTORS, TargetedTask, fixed_goal, without_target
from wbc.tasks import DampingTask, MomentumTask
from wbc.tasks.momentum import ANGULAR, LINEAR
from wbc.validate import Array

ROWS = LINEAR + ANGULAR
COMPONENTS = {"all": ROWS, "linear": LINEAR, "angular": ANGULAR}

Components = Annotated[
    Annotated[str, Words(tuple(COMPONENTS))]
    | Annotated[NonEmpty[Annotated[str, Words(ROWS)]], Distinct],
    Forms(f"{', '.join(COMPONENTS)}, or a list of {' '.join(ROWS)}"),
]
MomentumTarget = Annotated[
    Annotated[ListOf[Number], Field(min_length=1, max_length=6)] | FromPlan | FromMotion,
    Forms("a list of numbers, {plan: file}, or {motion: file}"),
]


class DampingSpec(MotionTaskSpec):
    """Rest: velocities as low as other tasks allow."""

    type: Literal["damping"]
    target: Literal["rest"] = "rest"
    """The target: rest."""
    joints: dict[Name, NonNegative] = Field(default_factory=dict)
    """Factors on the weight by joint name or pattern ("*_knee*"); 0 leaves a joint out."""
    base: bool = default_of(DampingTask, "base")
    """Whether to include the base's velocity."""
    kd: NonNegative | None = None
    """At the torque level: velocities decay as exp(-kd t) [1/s]; left out: 20."""
    weight: NonNegative = 1.0
    """Weight of the task [1/(rad/s)] or [1/(m/s)]."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        return without_target(DampingTask(start.robot, name=name, **self.settings()))


class MomentumSpec(MotionTaskSpec):
    """Centroidal momentum; a rate already, so there is no error to remove by a gain."""

    of_plan: ClassVar[tuple[str, ...]] = ("momentum", "momentum_rate")
    no_posture: ClassVar[str] = "momentum is about velocities, a posture has none"

    type: Literal["momentum"]
    components: Components = "all"
    """linear (lx ly lz), angular about the centre of mass (kx ky kz), all, or a list of these."""
    kd: NonNegative | None = None
    """At the torque level: the error decays as exp(-kd t) [1/s]; left out: 20."""
    target: MomentumTarget = default_of(MomentumTask, "target")
    """Target momentum, linear [kg m/s] then angular [kg m^2/s], world axes: six numbers, or one for
    each component; or {plan: ...} to follow a plan, or {motion: ...} a reference motion."""
    weight: Weight = 1.0
    """Weight of the task, one number or one per row [1/(kg m/s)] or [1/(kg m^2/s)]."""

    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task."""
        given = self.components
        rows = COMPONENTS[given] if isinstance(given, str) else tuple(given)
        still = np.zeros(len(ROWS))  # until a plan begins
        goal = still if isinstance(self.target, Followed) else entries(self.target, rows, ROWS)
        settings = {**self.settings(rows), "components": rows}
        task = MomentumTask(start.robot, goal, name=name, **settings)

        def set_target(value: Array, rate: Array, _: Array) -> None:
            task.set_target(value, rate)

        return TargetedTask(task, fixed_goal(goal), lambda now: now.momentum, VECTORS, set_target)
