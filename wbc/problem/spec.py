"""A whole problem as its file describes it: the format, and its JSON Schema."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints

from wbc.problem.controller_specs import ControllerChoice, QpSpec
from wbc.problem.part_specs import (
    LimitsChoice,
    LimitsSpec,
    RobotChoice,
    StartSpec,
    StopSpec,
    Support,
)
from wbc.problem.section import Section
from wbc.problem.task_specs import TaskSpec

# Free of dots and brackets, so that `--set tasks.NAME.gain=...` reads a name in one piece.
TaskName = Annotated[str, StringConstraints(pattern=r"^\w[\w -]*$")]


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
    tasks: Annotated[dict[TaskName, TaskSpec], Field(min_length=1)]
    """What the robot should do, by names of your choice."""
    limits: LimitsChoice = LimitsSpec()
    """What joints and base may do, or none."""
    controller: ControllerChoice = QpSpec()
    """How the tasks are turned into motion."""
    stop: StopSpec = StopSpec()
    """When the run ends, and what counts as success."""


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of a problem file, for editors and other checkers."""
    schema = ProblemSpec.model_json_schema()
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "wbc problem",
        **{key: _unwrapped(value) for key, value in schema.items() if key != "title"},
    }


def _unwrapped(schema: Any) -> Any:
    """Return a schema whose descriptions are on one line each."""
    if isinstance(schema, dict):
        return {key: _unwrapped(value) for key, value in schema.items()}
    if isinstance(schema, list):
        return [_unwrapped(value) for value in schema]
    return " ".join(schema.split()) if isinstance(schema, str) else schema
