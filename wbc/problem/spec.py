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

# One of the types that are imported above.
AnyTask = Annotated[TaskSpec, OneOf("type", "{type: com, target: [0, 0, 0.3]}", then="control")]
AnyConstraint = Annotated[ConstraintSpec, OneOf("type", "{type: box, upper: [null, null, 1]}")]
AnyController = Annotated[ControllerSpec, OneOf("method", "{solver: proxqp}", then="level")]

# Without dots and brackets, so that `--set tasks.NAME.gain=...` can be split at its dots.
PlainName = Annotated[str, StringConstraints(pattern=r"^\w[\w -]*$")]


class AnyTarget:
    """Annotates a target in any form that some type of task accepts.

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
    """Changes of a task in a phase."""

    target: Annotated[Any, AnyTarget()] | None = None
    """The task's target at the end of the phase, or of its ramp, in any form that the task itself
    accepts; relative ones are relative to the start of the run. The target moves there smoothly
    from its last value, or from the robot's actual one if the task was off; of forces from the
    task's own target."""
    weight: Weight | None = None
    """Weight at the end of the phase, to which it changes smoothly."""
    active: bool | None = None
    """Whether the task is on from this phase on. Its weight rises or falls smoothly within the
    phase; at once if the task's frame leaves or makes contact at its beginning."""


class PhaseSpec(Section):
    """A part of a run."""

    duration: Positive
    """Duration of the phase [s]."""
    ramp: Positive | None = None
    """Time in which targets and weights change [s]; left out: the phase's duration."""
    until: Literal["touchdown"] | None = None
    """touchdown: it ends as soon as the feet that the next phase puts down are loaded and flat,
    after duration at the latest; the time that is saved is added to the last phase. Of the torque
    level: feet feel the simulation's true forces, without noise or delay."""
    support: Support | None = None
    """Contacts in this phase, as in the problem's own support. A foot that was in the air must be
    on the ground by then, and is held where it is."""
    tasks: dict[PlainName, PhaseTaskSpec] = Field(default_factory=dict)
    """Changes of tasks, by the tasks' names."""


class StopSpec(Section):
    """When a run ends, and the criteria of success."""

    duration: Positive = default_of(Stop, "duration")
    """Longest time to run [s]."""
    speed: Positive | None = default_of(Stop, "speed")
    """The robot is at rest, and the run over, when no velocity is above this [rad/s, m/s] for ten
    ticks in a row; null, or where obstacles move: always run for the whole duration."""
    accept: dict[Name, Positive] = Field(default_factory=dict)
    """Tolerance on the norm of a task's error at the end, by the task's name."""
    balance: Number | None = default_of(Stop, "balance")
    """Least distance of the CoM's projection inside the soles in contact, at all times [m]; null:
    not checked."""
    slip: NonNegative | None = default_of(Stop, "slip")
    """Largest distance of a held frame from its anchor [m], unless it has a slack; null: not
    checked."""
    margins: NonNegative | None = default_of(Stop, "margins")
    """Largest violation of joint limits and constraints without slack [m or rad], once they have
    been met; null: not checked."""


_SECTIONS: dict[str, type[Section]]
_SECTIONS = {"simulation": SimulationSpec, "stop": StopSpec, "controller": QpSpec}


class ProblemSpec(Section):
    """A whole-body control problem: a robot with its tasks, limits and constraints."""

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
    """Initial state of the robot."""
    support: Support | None = None
    """Contacts, held at their initial poses: none (floating), a foot, both feet (double), all feet,
    or a list of feet and frames. Left out: none, for a robot without feet; a robot with feet needs
    it, here or in its first phase."""
    tasks: Annotated[dict[PlainName, AnyTask], Field(min_length=1)]
    """Tasks of the robot, by names of your choice."""
    phases: Annotated[dict[PlainName, PhaseSpec], Field(min_length=1)] | None = None
    """The parts of the run by names of your choice, in order; the run ends after the last. Without
    phases nothing changes until the run stops."""
    limits: LimitsChoice = LimitsSpec()
    """Limits of joints and base, or none."""
    constraints: dict[PlainName, AnyConstraint] = Field(default_factory=dict)
    """Further constraints, by names of your choice."""
    controller: AnyController = QpSpec()
    """The controller that solves for the motion."""
    hands: HandsSpec | None = None
    """Hands that are put on the walls of simulation.terrain when a push moves the capture point out
    of the soles; at the torque level, of a robot that stands. Left out: none."""
    simulation: SimulationSpec = SimulationSpec()
    """The physics, pushes and sensors of a problem of the torque level, for `wbc sim`."""
    stop: StopSpec = StopSpec()
    """When the run ends, and the criteria of success."""

    @property
    def ground_height(self) -> Ground | None:
        """Height of the ground at points, world axes; None if it is level and without steps."""
        terrain = self.simulation.terrain
        level = self.controller.level != "torque" or not (any(terrain.slope) or terrain.steps)
        return None if level else self.simulation.ground().height

    @property
    def surroundings_move(self) -> bool:
        """Whether an obstacle moves, which a robot at rest has to wait for."""
        return any(constraint.moves for constraint in self.constraints.values())

    @property
    def timed_by(self) -> str:
        """Name of the section that sets the duration if there are no phases."""
        return "simulation" if self.controller.level == "torque" else "stop"

    @property
    def whole_stop(self) -> StopSpec:
        """When the run ends: as in ``stop``, but after the last phase if there are phases.

        Where obstacles move the whole duration is run, whether the robot is at rest or not.

        A simulation ends after its own duration; other criteria of ``stop`` are used as given: a
        push may move the CoM out of the soles.
        """
        update: dict[str, float | None] = {"speed": None} if self.surroundings_move else {}
        if self.controller.level == "torque":
            given = self.stop.model_fields_set
            update |= dict.fromkeys({"balance", "slip", "margins"} - given)
            update |= {"duration": self.simulation.duration, "speed": None}
        if self.phases is not None:
            duration = sum(phase.duration for phase in self.phases.values())
            update |= {"duration": duration, "speed": None}
        return self.stop.model_copy(update=update)
