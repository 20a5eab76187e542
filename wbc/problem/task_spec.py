"""Keys that all tasks of a problem file have; each type of task is a file in ``kinds``."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from pydantic import Field

from wbc.laws import VelocityLaw
from wbc.problem.mistakes import Misplaced
from wbc.problem.section import Fraction, NonNegative, Positive, Section, default_of
from wbc.robot import Robot, Snapshot
from wbc.run.ramps import TargetedTask
from wbc.tasks import Task

KEPT = ("type", "control", "target", "active", "ramp", "law")  # keys that build() reads itself


class TaskSpec(Section):
    """The base of every task's description.

    A type of task is a subclass with a ``type`` of its own, a ``target``, a ``weight``, and
    :meth:`build`. Keys that are added here, or to the classes below, are passed to the task's class
    under the same name.
    """

    no_posture: ClassVar[str] = ""
    """Why a search over postures cannot use such a task; empty if it can."""
    of_plan: ClassVar[tuple[str, ...]] = ()
    """Names of the plan's targets that it follows: of value, rate and acceleration."""
    level: ClassVar[str] = ""
    """The only control level that supports such tasks; empty if both do."""

    type: str
    target: Any
    weight: Any
    priority: int = Field(default=default_of(Task, "priority"), ge=0, le=9)
    """Strict level, 0 the most important: a level is never disturbed by a later one."""
    active: bool = True
    """false: the task is off, until a phase turns it on."""

    @abstractmethod
    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task, for a robot that starts at ``start``.

        Raises WbcError: an unknown frame or joint, or numbers that do not fit.
        """

    @property
    def moved_frame(self) -> str | None:
        """The frame that the task moves, which must not be held at the same time."""
        return None

    @property
    def contact_frames(self) -> tuple[str, ...]:
        """Frames of contacts that the task refers to."""
        return ()

    def check_change(self, before: Self) -> None:
        """Raise an error if a phase changes what it cannot change of the task ``before``.

        Raises Misplaced: such a change.
        """

    def feet_below(self, robot: Robot) -> tuple[str, ...]:
        """Return the feet above which the target lies; they must be in contact when it is set."""
        return ()

    def settings(self, rows: Sequence[str] = ()) -> dict[str, Any]:
        """Return the keyword arguments of the task's class: all keys but those that say how.

        Raises Misplaced: a list of weights that does not fit ``rows``, or two gains.
        """
        if isinstance(self.weight, tuple) and len(self.weight) != len(rows):
            raise Misplaced(
                f"needs one number, or {len(rows)} ({', '.join(rows)}), got {len(self.weight)}",
                "weight",
            )
        values = {key: getattr(self, key) for key in type(self).model_fields if key not in KEPT}
        if values.get("gain_per_second") is not None:
            if "gain" in self.model_fields_set:
                raise Misplaced("give gain or gain_per_second, not both", "gain_per_second")
            del values["gain"]
        return {key: value for key, value in values.items() if value is not None}


class MotionTaskSpec(TaskSpec):
    """Keys of all tasks of motion, at either level."""

    singular_threshold: NonNegative = default_of(VelocityLaw, "singular_threshold")
    """Singular values of the Jacobian below this are singular, counting the motions that contacts
    and earlier levels leave [unit of the error/s per rad/s]: the task's rate is reduced in their
    directions, which keeps joint rates small. 0: never. Of the velocity level."""
    kd: NonNegative | None = None
    """At the torque level: damping of the error [1/s]; left out: critical, 2 sqrt(kp)."""


class ForceTaskSpec(TaskSpec):
    """Keys of all tasks of contact forces and torques; they have no gains."""

    level: ClassVar[str] = "torque"


class ErrorTaskSpec(MotionTaskSpec):
    """Keys of all tasks with an error to remove."""

    gain: Fraction = default_of(VelocityLaw, "gain")
    """Fraction of the error to remove in one tick, in (0, 1]."""
    gain_per_second: Positive | None = default_of(VelocityLaw, "gain_per_second")
    """Instead of gain: rate [1/s] at which the error decays, whatever the time step is."""
    lm_damping: NonNegative = default_of(VelocityLaw, "lm_damping")
    """Levenberg-Marquardt damping: steadies a task whose target cannot be reached. Of the velocity
    level, as the gains."""
    weighs_error: bool = default_of(VelocityLaw, "weighs_error")
    """Whether the weight applies to the error, whatever the gain, and so decides what errors
    competing tasks have at rest. Of the velocity level."""
    kp: NonNegative | None = None
    """At the torque level: stiffness of the error [1/s^2]; left out: 100."""
    ramp: Positive | None = None
    """Time [s] in which the target moves smoothly from the initial value."""
