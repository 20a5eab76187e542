"""Minimum-jerk ramps of targets: vectors, rotations, placements, directions, configurations.

Each kind is a space with a difference, which is a vector, and its inverse, ``integrate``.
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
# Returns the value that a target moves to, from the state and the target now.
Goal = Callable[[Snapshot, Array], Array]
# Sets a task's law for a state.
UpdateLaw = Callable[[Snapshot], None]


class Space(NamedTuple):
    """Space of a target: ``integrate(start, difference(start, end)) == end``.

    Parts of a displacement d add up: integrating s d and then t d is integrating (s + t) d.
    """

    # Returns the displacement, a vector, from one value to another.
    difference: Callable[[Array, Array], Array]
    integrate: Callable[[Array, Array], Array]  # returns the value at the end of a displacement


def configuration_space(robot: Robot) -> Space:
    """Return the space of configurations (nq,); continuous joints take the shorter way."""
    return Space(robot.difference, lambda q, displacement: robot.integrate(q, displacement, 1.0))


def placement(position: Array, rotation: Array) -> Array:
    """Return a rotation (3, 3) and a position (3,) as one value (3, 4)."""
    return np.column_stack((rotation, position))


def _placement_difference(start: Array, end: Array) -> Array:
    """Return the difference of the positions [m] above the rotation vector [rad] (6,)."""
    rotation = ROTATIONS.difference(start[:, :3], end[:, :3])
    return np.concatenate((end[:, 3] - start[:, 3], rotation))


def _integrate_placement(start: Array, displacement: Array) -> Array:
    rotation = ROTATIONS.integrate(start[:, :3], displacement[3:])
    return placement(start[:, 3] + displacement[:3], rotation)


def _direction_difference(start: Array, end: Array) -> Array:
    """Return the rotation vector (3,) [rad], world axes, that turns one direction into another."""
    a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine < 1e-9:  # parallel or opposite: any orthogonal axis
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        sine = 0.0
    return float(np.arctan2(sine, cosine)) * axis / np.linalg.norm(axis)


VECTORS = Space(lambda start, end: end - start, lambda start, displacement: start + displacement)
# Rotation matrices (3, 3); displacements are rotation vectors in the rotating axes.
ROTATIONS = Space(
    lambda start, end: log_rotation(start.T @ end),
    lambda start, displacement: start @ exp_rotation(displacement),
)
# Rotation and position (3, 4); the position moves on a straight line.
PLACEMENTS = Space(_placement_difference, _integrate_placement)
# Unit vectors (3,), rotated about the axis orthogonal to both.
DIRECTIONS = Space(
    _direction_difference, lambda start, displacement: exp_rotation(displacement) @ start
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
        """Return value, rate and acceleration at ``t`` [s]; constant before 0 and after the end.

        Rate and acceleration are along :attr:`displacement`: for rotations angular velocity and
        acceleration in the rotating axes.
        """
        x = min(max(t / self.duration, 0.0), 1.0)
        slope, curvature = minimum_jerk_rates(x)
        rate, acceleration = slope / self.duration, curvature / self.duration**2
        # Written from the end, so that the end is met exactly.
        value = self.space.integrate(self.end, -(1.0 - minimum_jerk(x)) * self.displacement)
        return value, rate * self.displacement, acceleration * self.displacement


class Course(Protocol):
    """Trajectory of a target, such as a ramp."""

    @property
    def duration(self) -> float:
        """Time at which it is at rest at its end [s]."""

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at ``t`` [s]."""


@dataclass(frozen=True, eq=False)
class MovingTarget:
    """A course that starts at ``begins`` [s], and the setter of its value, rate, acceleration."""

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
    goal: Goal  # of the target
    # The task quantity's current value, in the form of the target.
    current: Callable[[Snapshot], Array]
    space: Space  # of both
    set_target: SetTarget  # sets the task's target
    # Duration of the target's ramp from the start to the goal [s], or None.
    ramp: float | None = None
    # Trajectory of the target in place of a ramp, from the start of the run on, or None.
    course: Course | None = None
    # Returns a function that sets the task's law before each tick of a controller, or None.
    attendant: Callable[[Controller], UpdateLaw] | None = None
    # (k,) initial; that of the task may change in a run.
    weight: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "weight", self.task.weight)

    def moving(self, start: Snapshot) -> MovingTarget | None:
        """Return the target's motion from the start on, if it moves."""
        if self.course is not None:
            return MovingTarget(self.course, self.set_target)
        if self.ramp is None:
            return None
        current = self.current(start)
        ramp = MinimumJerk(current, self.goal(start, current), self.ramp, self.space)
        return MovingTarget(ramp, self.set_target)


def pose_setter(task: Any) -> SetTarget:
    """Return the setter of a pose task's target in :data:`PLACEMENTS`."""

    def set_target(value: Array, rate: Array, acceleration: Array) -> None:
        R = value[:, :3]
        twists = (np.concatenate((twist[:3], R @ twist[3:])) for twist in (rate, acceleration))
        task.set_target(value[:, 3], R, *twists)

    return set_target


def orientation_setter(task: Any) -> SetTarget:
    """Return the setter of an orientation task's target in :data:`ROTATIONS`."""
    return lambda value, rate, acceleration: task.set_target(
        value, value @ rate, value @ acceleration
    )


def axis_setter(task: Any) -> SetTarget:
    """Return the setter of an axis task's target in :data:`DIRECTIONS`."""

    def set_target(value: Array, w: Array, alpha: Array) -> None:
        rate = np.cross(w, value)
        task.set_target(value, rate, np.cross(alpha, value) + np.cross(w, rate))

    return set_target


def force_target(task: Any, goal: Array) -> TargetedTask:
    """Return a task about forces; snapshots have none, so ramps begin at its own target."""
    return TargetedTask(
        task, fixed_goal(goal), lambda _: goal, VECTORS, lambda value, *_: task.set_target(value)
    )


def without_target(task: Task) -> TargetedTask:
    """Return a task without a target."""
    none = np.zeros(0)
    return TargetedTask(task, fixed_goal(none), lambda _: none, VECTORS, lambda *_: None)


def fixed_goal(goal: Array) -> Goal:
    """Return a constant goal."""
    return lambda _, __: goal
