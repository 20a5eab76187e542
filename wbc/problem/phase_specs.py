"""Phases as a problem file describes them: a run in parts, each with its support and its targets.

Only what changes is written. What a phase does not mention stays as it was: the support, where a
task's target is, how much the task weighs, and whether it is in use.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, SkipValidation, StringConstraints

from wbc.problem.section import Number, Positive, Section, Weight
from wbc.problem.support import Support
from wbc.problem.target_specs import (
    ComTarget,
    DirectionTarget,
    InertiaTarget,
    PointTarget,
    PoseTarget,
    PostureTarget,
    RotationTarget,
)

# Free of dots and brackets, so that `--set tasks.NAME.gain=...` reads a name in one piece.
PlainName = Annotated[str, StringConstraints(pattern=r"^\w[\w -]*$")]

# Which of these it must be depends on the task, so it is checked with the task at hand.
AnyTarget = SkipValidation[
    ComTarget
    | PointTarget
    | RotationTarget
    | PoseTarget
    | DirectionTarget
    | InertiaTarget
    | PostureTarget
    | tuple[Number, ...]
]


class PhaseTaskSpec(Section):
    """What a phase changes about a task."""

    target: AnyTarget | None = None
    """Where the task's target should be at the end of the phase, in any form that the task itself
    takes; what is relative is relative to the start of the run. It moves smoothly from where it is,
    or from where the robot is if the task was off."""
    weight: Weight | None = None
    """Weight at the end of the phase; it changes smoothly."""
    active: bool | None = None
    """Whether the task is in use from this phase on. Its weight rises or falls smoothly within the
    phase; at once if the task's frame is let go or put down at its beginning."""


class PhaseSpec(Section):
    """A part of a run."""

    duration: Positive
    """How long it takes [s]."""
    support: Support | None = None
    """What is held in this phase, as in the problem's own support. A foot that was in the air must
    have come to the ground, and is held where it is."""
    tasks: dict[PlainName, PhaseTaskSpec] = Field(default_factory=dict)
    """What changes, by the names of the problem's tasks."""


Phases = Annotated[dict[PlainName, PhaseSpec], Field(min_length=1)]
