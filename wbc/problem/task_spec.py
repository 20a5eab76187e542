"""What all tasks of a problem file have in common; each kind of task is a file in ``kinds``."""

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


class TaskSpec(Section):
    """What all tasks have in common.

    A kind of task is a subclass with a ``type`` of its own, a ``target``, a ``weight``, and
    :meth:`build`. Keys that are added here, or to the classes below, are handed on to the task's
    class under the same name.
    """

    no_posture: ClassVar[str] = ""
    """Why a search over postures has no use for such a task; empty if it has."""
    of_plan: ClassVar[tuple[str, ...]] = ()
    """What of a plan's targets it follows: names of value, rate and acceleration."""
    level: ClassVar[str] = ""
    """The only control level that has such tasks; empty if both have."""

    type: str
    target: Any
    weight: Any
    priority: int = Field(default=default_of(Task, "priority"), ge=0, le=9)
    """Strict level, 0 the most important: a level never gives way to a later one."""
    active: bool = True
    """false: the task is off, until a phase puts it to use."""

    @abstractmethod
    def build(self, name: str, start: Snapshot) -> TargetedTask:
        """Return the task, for a robot that starts at ``start``.

        Raises
        ------
        WbcError
            An unknown frame or joint, or numbers that do not fit.
        """

    @property
    def moved_frame(self) -> str | None:
        """The frame that the task moves, which must not be held at the same time."""
        return None

    @property
    def contact_frames(self) -> tuple[str, ...]:
        """Frames that the file names as those of contacts."""
        return ()

    def check_change(self, before: Self) -> None:
        """Refuse what a phase cannot change about the task as it was ``before``.

        Raises
        ------
        Misplaced
            Such a change.
        """

    def feet_below(self, robot: Robot) -> tuple[str, ...]:
        """Return the feet that the target is above; they must stand when it is set."""
        return ()

    def settings(self, rows: Sequence[str] = ()) -> dict[str, Any]:
        """Return the keywords that the task's class hands on to :class:`~wbc.tasks.Task`.

        Raises
        ------
        Misplaced
            A list of weights that does not fit ``rows``, or two gains.
        """
        if isinstance(self.weight, tuple) and len(self.weight) != len(rows):
            raise Misplaced(
                f"needs one number, or {len(rows)} ({', '.join(rows)}), got {len(self.weight)}",
                "weight",
            )
        known = type(self).model_fields.keys()
        values = {key: getattr(self, key) for key in HANDED_ON if key in known}
        if values.get("gain_per_second") is not None:
            if "gain" in self.model_fields_set:
                raise Misplaced("give gain or gain_per_second, not both", "gain_per_second")
            del values["gain"]
        return {key: value for key, value in values.items() if value is not None}


class MotionTaskSpec(TaskSpec):
    """What tasks about the motion have in common, at either level."""

    singular_threshold: NonNegative = default_of(VelocityLaw, "singular_threshold")
    """Singular values of the Jacobian below this are singular, counting the motions that contacts
    and earlier levels leave [unit of the error/s per rad/s]: the task asks for less in their
    directions, so that joints need not race. 0: never. Of the velocity level."""
    kd: NonNegative | None = None
    """At the torque level: damping of the error [1/s]; left out: critical, 2 sqrt(kp)."""


class ForceTaskSpec(TaskSpec):
    """What tasks about contact forces and torques have in common; there are no gains."""

    level: ClassVar[str] = "torque"


class ErrorTaskSpec(MotionTaskSpec):
    """What tasks with an error to remove have in common."""

    gain: Fraction = default_of(VelocityLaw, "gain")
    """Fraction of the error to remove in one tick, in (0, 1]."""
    gain_per_second: Positive | None = default_of(VelocityLaw, "gain_per_second")
    """Instead of gain: rate [1/s] at which the error decays, whatever the time step is."""
    lm_damping: NonNegative = default_of(VelocityLaw, "lm_damping")
    """Levenberg-Marquardt damping: steadies a task whose target cannot be reached. Of the velocity
    level, as the gains."""
    weighs_error: bool = default_of(VelocityLaw, "weighs_error")
    """Whether the weight is that of the error, whatever the gain: what tasks that compete give way
    at rest. Of the velocity level."""
    kp: NonNegative | None = None
    """At the torque level: stiffness of the error [1/s^2]; left out: 100."""
    ramp: Positive | None = None
    """Time [s] in which the target moves smoothly from what is there at the start."""


HANDED_ON = ErrorTaskSpec.model_fields.keys() - {"type", "target", "active", "ramp"}
