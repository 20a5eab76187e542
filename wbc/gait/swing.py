"""The swing foot's trajectory, whose goal and time of landing may change at any moment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from wbc.gait.crossing import Crossing
from wbc.native import doubles, ffi, lib
from wbc.validate import Array, read_only

a_foot: Any = partial(ffi.from_buffer, ffi.typeof("wbc_swing_foot *"))
a_path: Any = partial(ffi.from_buffer, ffi.typeof("wbc_swing_path *"))

# Acceleration of a late foot up to its descent speed [m/s^2]: with a jump in speed, arms were
# thrown up at their torque bounds in the last tick of most steps.
SPEED_UP: float = lib.wbc_speed_up
NO_EDGE = (0.0,) * 5


class SwingMotion(NamedTuple):
    """A value, its rate and acceleration: numbers all, or arrays (k,)."""

    value: Any
    rate: Any
    acceleration: Any

    @classmethod
    def rest(cls, value: float | Array) -> SwingMotion:
        """Return a constant value."""
        return SwingMotion(value, 0.0 * value, 0.0 * value)

    def spring_towards(self, goal: float | Array, rate: float, dt: float) -> SwingMotion:
        """Return it ``dt`` later, drawn to ``goal`` by a critically damped spring [rate: 1/s]."""
        acceleration = rate**2 * (goal - self.value) - 2.0 * rate * self.rate
        v = self.rate + acceleration * dt
        return SwingMotion(self.value + v * dt, v, acceleration)


def towards(now: SwingMotion, goal: float | Array, left: float, dt: float) -> SwingMotion:
    """Return the motion ``dt`` later on the curve of least jerk to rest at ``goal`` after ``left``.

    See source/swing.c.
    """
    motions, end = np.array(now, dtype=float), np.array(goal, dtype=float)
    at = doubles(motions)
    lib.wbc_towards(end.size, left, dt, at, doubles(end), at)
    return SwingMotion(*(motions if end.ndim else motions.tolist()))


class FootPose(NamedTuple):
    """Reference of a foot, read-only: position (3,), rotation (3, 3), twist and derivative (6,)."""

    position: Array
    rotation: Array
    rate: Array
    acceleration: Array


class SwingFoot(NamedTuple):
    """A swing foot, whose motion is that of source/swing.c.

    In a shortened step the clearance falls with the square of the time, so that the upward
    acceleration is no larger than in a nominal one: it would throw the CoM up, and the foot would
    land late. When the plan changes the height does not jump: its offset from the new curve decays
    on a minimum-jerk curve until touch-down.
    """

    numbers: Array  # (21,) where it is, how it moves, and what is done: a ``wbc_swing_foot``
    path: Array  # (11,) what does not change: a ``wbc_swing_path``
    normal: Array  # (3,) of the ground where it lands, a unit vector
    crossing: Crossing | None  # path over edges, if any are known
    placed: Array  # (24,) its pose, once it was advanced

    @classmethod
    def lift_off(
        cls,
        pose: Array,
        height: float,
        normal: Array,
        clearance: float,
        usual: float,
        descent: float,
        sole: Array | None = None,
        crossing: Crossing | None = None,
    ) -> SwingFoot:
        """Return a foot that leaves the ground at ``pose`` (x, y, yaw).

        ``normal``: (3,) of the ground where it lands, a unit vector.
        ``clearance``: how high it is lifted in the ``usual`` time [m].
        ``usual``: nominal swing time [s].
        ``descent``: speed at which it goes on downwards when late [m/s].
        ``sole``: its normal (3,) at lift-off, if it differs from that of the landing.
        """
        tilt, still = (normal if sole is None else sole)[:2], np.zeros(10)
        numbers = np.array((*pose, *tilt, *still, height, 0.0, 0.0, 0.0, 1.0, 0.0))
        over = NO_EDGE if crossing is None else (1.0, *crossing)
        path = np.array((height, *normal[:2], clearance, usual, descent, *over))
        return cls(numbers, path, normal, crossing, np.zeros(24))

    @property
    def place(self) -> complex:
        """Where it is, as x + i y [m]."""
        return complex(*self.numbers[:2].tolist())

    @property
    def speed(self) -> complex:
        """How fast it goes, likewise [m/s]."""
        return complex(*self.numbers[5:7].tolist())

    @property
    def done(self) -> float:
        """Part of the path that is done, in [0, 1]."""
        return self.numbers.item(18)

    @property
    def late(self) -> float:
        """Time since the planned touch-down [s]."""
        return self.numbers.item(20)

    def advance(
        self, goal: tuple[float, float, float], ground: float, left: float, dt: float, most: float
    ) -> SwingFoot:
        """Return the foot ``dt`` later; it lands at ``goal`` (x, y, yaw) after ``left`` [s].

        ``ground`` is the height below the goal [m], ``most`` the largest acceleration of a foot
        that stops before it passes the goal [m/s^2].
        """
        numbers, placed = np.empty(21), np.empty(24)
        before, after = a_foot(self.numbers), a_foot(numbers)
        way = *goal, ground, left, dt, most
        lib.wbc_swing(a_path(self.path), *way, before, after, doubles(placed))
        return SwingFoot(numbers, self.path, self.normal, self.crossing, read_only(placed))

    def pose(self) -> FootPose:
        """Return the foot's reference; rates are of first order in its tilt."""
        placed = self.placed
        return FootPose(placed[:3], placed[3:12].reshape(3, 3), placed[12:18], placed[18:])


def yaw_of(R: Array | Sequence[Sequence[float]]) -> float:
    """Return the heading [rad] of a frame's x axis."""
    return math.atan2(R[1][0], R[0][0])


def turned(yaw: float) -> Array:
    """Return the rotation (3, 3) about the vertical."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def unit(vector: Array) -> Array:
    """Return the direction of a vector."""
    return np.asarray(vector / np.linalg.norm(vector))
