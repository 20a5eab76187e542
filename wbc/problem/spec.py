"""A whole problem as its file describes it: the format."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from wbc.problem.constraint_specs import ConstraintSpec
from wbc.problem.controller_specs import ControllerChoice, QpSpec
from wbc.problem.part_specs import (
    LimitsChoice,
    LimitsSpec,
    RobotChoice,
    StartSpec,
    StopSpec,
)
from wbc.problem.phase_specs import Phases, PlainName
from wbc.problem.section import Section
from wbc.problem.support import Support
from wbc.problem.task_specs import TaskSpec


class ProblemSpec(Section):
    """A whole-body control problem: a robot, what it should do, and what it must respect."""

    version: Literal[1] = 1
    """Version of this format."""
    robot: RobotChoice
    """A name that `wbc robots` lists, a .urdf or .xml file relative to this file, or a mapping."""
    start: StartSpec = StartSpec()
    """Where the robot starts."""
    support: Support = "floating"
    """What is held where it is at the start: nothing (floating), a foot, both feet (double), or a
    list of frames."""
    tasks: Annotated[dict[PlainName, TaskSpec], Field(min_length=1)]
    """What the robot should do, by names of your choice."""
    phases: Phases | None = None
    """The parts of the run by names of your choice, in order; the run ends after the last. Without
    phases everything is as it is at the start, until the run stops."""
    limits: LimitsChoice = LimitsSpec()
    """What joints and base may do, or none."""
    constraints: dict[PlainName, ConstraintSpec] = Field(default_factory=dict)
    """What else the robot must respect, by names of your choice."""
    controller: ControllerChoice = QpSpec()
    """How the tasks are turned into motion."""
    stop: StopSpec = StopSpec()
    """When the run ends, and what counts as success."""

    @property
    def whole_stop(self) -> StopSpec:
        """When the run really ends: ``stop``, but after the last phase if there are phases."""
        if self.phases is None:
            return self.stop
        duration = sum(phase.duration for phase in self.phases.values())
        return self.stop.model_copy(update={"duration": duration, "speed": None})
