"""Targets that move smoothly: minimum-jerk ramps in the space that the target lives in.

A target is a vector, a rotation, a placement, a direction or a configuration. Each kind has a
difference, which is a vector, and a way to go a part of it; a ramp needs no more than that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from wbc.controllers import Controller
from wbc.minimum_jerk import minimum_jerk, minimum_jerk_rates
from wbc.robot import Robot, Snapshot
from wbc.rotations import exp_rotation, log_rotation
from wbc.tasks import Task
from wbc.validate import Array

# Takes a target's value, rate and acceleration.
SetTarget = Callable[[Array, Array, Array], None]
# Returns where a target is to be, from the robot now and the target until then.
Goal = Callable[[Snapshot, Array], Array]
# Sets what a task's law is to be, from the robot now.
Attend = Callable[[Snapshot], None]


class Space(NamedTuple):
    """Where targets of one kind live: ``moved(start, difference(start, end)) == end``.

    Parts of a displacement add up: ``moved(moved(x, s d), t d) == moved(x, (s + t) d)``.
    """

    # Returns the displacement, a vector, from one value to another.
    difference: Callable[[Array, Array], Array]
    moved: Callable[[Array, Array], Array]  # returns the value at the end of a displacement


def configurations(robot: Robot) -> Space:
    """Return the space of configurations (nq,); continuous joints turn the shorter way."""
    return Space(robot.difference, lambda q, displacement: robot.integrate(q, displacement, 1.0))


def placement(position: Array, rotation: Array) -> Array:
    """Return a position (3,) and a rotation (3, 3) side by side, as one value (3, 4)."""
    return np.column_stack((rotation, position))


def _rotation_between(start: Array, end: Array) -> Array:
    """Return log(start' end) (3,) [rad]."""
    return log_rotation(start.T @ end)


def _rotated(start: Array, displacement: Array) -> Array:
    return start @ exp_rotation(displacement)


def _between_placements(start: Array, end: Array) -> Array:
    """Return the difference of the positions [m] above the rotation vector [rad] (6,)."""
    rotation = _rotation_between(start[:, :3], end[:, :3])
    return np.concatenate((end[:, 3] - start[:, 3], rotation))


def _moved_placement(start: Array, displacement: Array) -> Array:
    rotation = _rotated(start[:, :3], displacement[3:])
    return placement(start[:, 3] + displacement[:3], rotation)


def _between_directions(start: Array, end: Array) -> Array:
    """Return the rotation vector (3,) [rad], world axes, that turns one direction into another."""
    a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine < 1e-9:  # the same or opposite: any axis at right angles will do for half a turn
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        sine = 0.0
    return float(np.arctan2(sine, cosine)) * axis / np.linalg.norm(axis)


VECTORS = Space(lambda start, end: end - start, lambda start, displacement: start + displacement)
# Rotation matrices (3, 3); displacements are rotation vectors in the rotating axes.
ROTATIONS = Space(_rotation_between, _rotated)
# A rotation and a position side by side, (3, 4); the position moves on a straight line.
PLACEMENTS = Space(_between_placements, _moved_placement)
# Unit vectors (3,), turned about the axis at right angles to both.
DIRECTIONS = Space(
    _between_directions, lambda start, displacement: exp_rotation(displacement) @ start
)


@dataclass(frozen=True, eq=False)
class MinimumJerk:
    """The path from ``start`` to ``end`` in ``duration`` [s] of least integrated squared jerk.

    s(x) = 10 x^3 - 15 x^4 + 6 x^5 with x = t / duration: rate and acceleration are zero at both
    ends and continuous everywhere (Flash and Hogan 1985). In another space than that of plain
    vectors, s is the part of the displacement that is done.
    """

    start: Array
    end: Array
    duration: float
    space: Space = VECTORS

    @cached_property
    def displacement(self) -> Array:
        """From start to end, as a vector."""
        return self.space.difference(self.start, self.end)

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at ``t`` [s]; at rest before 0 and after the end.

        Rate and acceleration are those along :attr:`displacement`, a direction that stays: for
        rotations angular velocity and acceleration in the rotating axes.
        """
        x = min(max(t / self.duration, 0.0), 1.0)
        slope, curvature = minimum_jerk_rates(x)
        rate, acceleration = slope / self.duration, curvature / self.duration**2
        # Written from the end, so that the end is met exactly.
        value = self.space.moved(self.end, -(1.0 - minimum_jerk(x)) * self.displacement)
        return value, rate * self.displacement, acceleration * self.displacement


class Course(Protocol):
    """Where a target goes over time, such as a ramp."""

    @property
    def duration(self) -> float:
        """When it is at rest at its end [s]."""

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at ``t`` [s]."""


@dataclass(frozen=True, eq=False)
class MovingTarget:
    """A course that starts at ``begins`` [s], and what takes its value, rate and acceleration."""

    course: Course
    set_target: SetTarget
    begins: float = 0.0

    def move_to(self, t: float) -> None:
        """Set the target to its value at time ``t`` [s]."""
        self.set_target(*self.course.at(t - self.begins))


@dataclass(frozen=True, eq=False)
class TargetedTask:
    """A task, and how its target is found and moved."""

    task: Task
    goal: Goal  # where the target should be
    # The task quantity's current value, in the form of the target.
    current: Callable[[Snapshot], Array]
    space: Space  # where both live
    set_target: SetTarget  # sets the task's target
    # Time [s] in which the target moves from the start to the goal, or None.
    ramp: float | None = None
    # Where the target goes instead, from the start of the run on, or None.
    course: Course | None = None
    # Returns what sets the task's law before each tick of a run with a controller, or None.
    attendant: Callable[[Controller], Attend] | None = None
    # (k,) of the task as it was made; that of the task itself may change in a run.
    weight: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "weight", self.task.weight)

    def moving(self, start: Snapshot) -> MovingTarget | None:
        """Return what moves the target from the start on, if anything does."""
        if self.course is not None:
            return MovingTarget(self.course, self.set_target)
        if self.ramp is None:
            return None
        here = self.current(start)
        ramp = MinimumJerk(here, self.goal(start, here), self.ramp, self.space)
        return MovingTarget(ramp, self.set_target)


def placed(task: Any) -> SetTarget:
    """Return what hands a pose task a placement (3, 4) and how it moves (:data:`PLACEMENTS`)."""

    def set_target(value: Array, rate: Array, acceleration: Array) -> None:
        R = value[:, :3]
        turning = (np.concatenate((one[:3], R @ one[3:])) for one in (rate, acceleration))
        task.set_target(value[:, 3], R, *turning)

    return set_target


def turned(task: Any) -> SetTarget:
    """Return what hands an orientation task a rotation and how it turns (:data:`ROTATIONS`)."""

    def set_target(value: Array, rate: Array, acceleration: Array) -> None:
        task.set_target(value, value @ rate, value @ acceleration)

    return set_target


def pointed(task: Any) -> SetTarget:
    """Return what hands an axis task a direction and how it moves (:data:`DIRECTIONS`)."""

    def set_target(value: Array, w: Array, alpha: Array) -> None:
        rate = np.cross(w, value)
        task.set_target(value, rate, np.cross(alpha, value) + np.cross(w, rate))

    return set_target


def unmeasured(task: Any, goal: Array) -> TargetedTask:
    """Return a task about forces: no snapshot has its value, so changes begin at its own target."""

    def set_target(value: Array, *_: Array) -> None:
        task.set_target(value)

    return TargetedTask(task, fixed_goal(goal), lambda _: goal, VECTORS, set_target)


def untargeted(task: Task) -> TargetedTask:
    """Return a task without a target."""
    none = np.zeros(0)
    return TargetedTask(task, fixed_goal(none), lambda _: none, VECTORS, lambda *_: None)


def fixed_goal(goal: Array) -> Goal:
    """Return a goal that is known from the start."""
    return lambda _, __: goal
