"""The format of problem files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, get_type_hints

from pydantic import Field, GetCoreSchemaHandler, StringConstraints
from pydantic_core import CoreSchema, core_schema

import wbc.problem.kinds  # noqa: F401
from wbc.problem.constraint_spec import ConstraintSpec
from wbc.problem.controller_spec import ControllerSpec, QpSpec
from wbc.problem.hands_spec import HandsSpec
from wbc.problem.robot_spec import LimitsChoice, LimitsSpec, RobotChoice, StartSpec
from wbc.problem.section import (
    Name,
    NonNegative,
    Number,
    OneOf,
    Positive,
    Section,
    Weight,
    default_of,
    leaves,
)
from wbc.problem.simulation_spec import SimulationSpec
from wbc.problem.support import Support
from wbc.problem.task_spec import TaskSpec
from wbc.run.phase_support import Ground
from wbc.run.stopping import Stop

# The kinds that are imported above.
AnyTask = Annotated[TaskSpec, OneOf("type", "{type: com, target: [0, 0, 0.3]}", then="control")]
AnyConstraint = Annotated[ConstraintSpec, OneOf("type", "{type: box, upper: [null, null, 1]}")]
AnyController = Annotated[ControllerSpec, OneOf("method", "{solver: proxqp}", then="level")]

# Free of dots and brackets, so that `--set tasks.NAME.gain=...` reads a name in one piece.
PlainName = Annotated[str, StringConstraints(pattern=r"^\w[\w -]*$")]


class AnyTarget:
    """Annotates a target in any form that some kind of task takes.

    The valid forms depend on the task, so it is checked together with the task.
    """

    def __get_pydantic_core_schema__(self, _: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        hints = (get_type_hints(kind, include_extras=True) for kind in leaves(TaskSpec))
        return core_schema.no_info_wrap_validator_function(
            lambda value, _: value,
            core_schema.union_schema([handler.generate_schema(each["target"]) for each in hints]),
            serialization=core_schema.plain_serializer_function_ser_schema(lambda value: value),
        )


class PhaseTaskSpec(Section):
    """What a phase changes about a task."""

    target: Annotated[Any, AnyTarget()] | None = None
    """Where the task's target should be at the end of the phase, or of its ramp, in any form that
    the task itself takes; what is relative is relative to the start of the run. It moves smoothly
    from where it is, or from where the robot is if the task was off; of forces from the task's own
    target."""
    weight: Weight | None = None
    """Weight at the end of the phase; it changes smoothly."""
    active: bool | None = None
    """Whether the task is in use from this phase on. Its weight rises or falls smoothly within the
    phase; at once if the task's frame is let go or put down at its beginning."""


class PhaseSpec(Section):
    """A part of a run."""

    duration: Positive
    """How long it takes [s]."""
    ramp: Positive | None = None
    """In which targets and weights get to where they should be [s]; left out: its duration."""
    until: Literal["touchdown"] | None = None
    """touchdown: it ends as soon as the feet that the next phase puts down bear load and lie flat,
    after duration at the latest; what is left of that, the last phase lasts longer. Of the torque
    level: feet feel the simulation's true forces, without noise or delay."""
    support: Support | None = None
    """What is held in this phase, as in the problem's own support. A foot that was in the air must
    have come to the ground, and is held where it is."""
    tasks: dict[PlainName, PhaseTaskSpec] = Field(default_factory=dict)
    """What changes, by the names of the problem's tasks."""


class StopSpec(Section):
    """When a run ends, and what must hold then."""

    duration: Positive = default_of(Stop, "duration")
    """Longest time to run [s]."""
    speed: Positive | None = default_of(Stop, "speed")
    """The robot is at rest, and the run over, when no velocity is above this [rad/s, m/s] for ten
    ticks in a row; null: always run for the whole duration."""
    accept: dict[Name, Positive] = Field(default_factory=dict)
    """Tolerance on the norm of a task's error at the end, by the task's name."""
    balance: Number | None = default_of(Stop, "balance")
    """How far inside the soles that stand the CoM's projection stays all the time [m]; null: no
    matter where."""
    slip: NonNegative | None = default_of(Stop, "slip")
    """Farthest that a held frame may be from its anchor [m], unless it has a slack; null: any."""
    margins: NonNegative | None = default_of(Stop, "margins")
    """By how much joint limits and constraints without slack may be exceeded [m or rad], once they
    are kept; null: by anything."""


_SECTIONS: dict[str, type[Section]]
_SECTIONS = {"simulation": SimulationSpec, "stop": StopSpec, "controller": QpSpec}


class ProblemSpec(Section):
    """A whole-body control problem: a robot, what it should do, and what it must respect."""

    elsewhere: ClassVar[Mapping[str, str]] = {
        key: f"{name}; write {name}: {{{key}: ...}}, or --set {name}.{key}=..."
        for name, section in _SECTIONS.items()
        for key in section.model_fields
    }

    version: Literal[1] = 1
    """Version of this format."""
    robot: RobotChoice
    """A name that `wbc robots` lists, a .urdf or .xml file relative to this file, or a mapping."""
    start: StartSpec = StartSpec()
    """Where the robot starts."""
    support: Support | None = None
    """What is held where it is at the start: nothing (floating), a foot, both feet (double), all
    feet, or a list of feet and frames. Left out: nothing, of a robot without feet; a robot with
    feet must say, here or in its first phase."""
    tasks: Annotated[dict[PlainName, AnyTask], Field(min_length=1)]
    """What the robot should do, by names of your choice."""
    phases: Annotated[dict[PlainName, PhaseSpec], Field(min_length=1)] | None = None
    """The parts of the run by names of your choice, in order; the run ends after the last. Without
    phases everything is as it is at the start, until the run stops."""
    limits: LimitsChoice = LimitsSpec()
    """What joints and base may do, or none."""
    constraints: dict[PlainName, AnyConstraint] = Field(default_factory=dict)
    """What else the robot must respect, by names of your choice."""
    controller: AnyController = QpSpec()
    """How the tasks are turned into motion."""
    hands: HandsSpec | None = None
    """Hands that lean on the walls of simulation.terrain when a push carries the capture point
    beyond the soles; at the torque level, of a robot that stands. Left out: none."""
    simulation: SimulationSpec = SimulationSpec()
    """The physics, pushes and sensors of a problem of the torque level, for `wbc sim`."""
    stop: StopSpec = StopSpec()
    """When the run ends, and what counts as success."""

    @property
    def ground_height(self) -> Ground | None:
        """Height of the ground at points, world axes; None if it is level and without steps."""
        terrain = self.simulation.terrain
        level = self.controller.level != "torque" or not (any(terrain.slope) or terrain.steps)
        return None if level else self.simulation.ground().height

    @property
    def timed_by(self) -> str:
        """The section that defines the duration if there are no phases."""
        return "simulation" if self.controller.level == "torque" else "stop"

    @property
    def whole_stop(self) -> StopSpec:
        """When the run ends: as in ``stop``, but after the last phase if there are phases.

        A simulation ends after its own duration; other criteria of ``stop`` are used as given: a
        push may move the CoM out of the soles.
        """
        update: dict[str, float | None] = {}
        if self.controller.level == "torque":
            given = self.stop.model_fields_set
            update = dict.fromkeys({"balance", "slip", "margins"} - given)
            update |= {"duration": self.simulation.duration, "speed": None}
        if self.phases is not None:
            duration = sum(phase.duration for phase in self.phases.values())
            update |= {"duration": duration, "speed": None}
        return self.stop.model_copy(update=update)
