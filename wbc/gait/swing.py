"""The way of a foot through the air, whose end and time of landing may change at any moment."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np

from wbc.minimum_jerk import minimum_jerk, minimum_jerk_rates
from wbc.validate import Array

# Nearer to the landing than this the goal is met as it is [s].
LEAST_LEFT = 0.03
# By which power of s (1 - s) a foot rises, while it goes ahead with s^3: the less, the sooner it
# is up, over an edge just before its toe; from 2 on its acceleration jumps.
STEEPNESS = 2.5
# Coefficients of s^0 to s^5 by value p, rate v, acceleration a and way d of a curve of unit time
# that ends at p + d, rate and acceleration zero.
QUINTIC = np.array(
    (
        (1.0, 0.0, 0.0, 0.0),
        (0.0, 1.0, 0.0, 0.0),
        (0.0, 0.0, 0.5, 0.0),
        (0.0, -6.0, -1.5, 10.0),
        (0.0, 8.0, 1.5, -15.0),
        (0.0, -3.0, -0.5, 6.0),
    )
)


class Motion(NamedTuple):
    """Values (k,), their rates and accelerations."""

    value: Array
    rate: Array
    acceleration: Array

    @classmethod
    def rest(cls, value: Array) -> Self:
        """Return no motion at all."""
        return cls(value, np.zeros_like(value), np.zeros_like(value))

    def sprung(self, goal: float, rate: float, dt: float) -> Self:
        """Return it ``dt`` later on a critically damped spring to ``goal`` of ``rate`` [1/s]."""
        acceleration = rate**2 * (goal - self.value) - 2.0 * rate * self.rate
        v = self.rate + acceleration * dt
        return type(self)(self.value + v * dt, v, acceleration)


def towards(now: Motion, goal: Array, left: float, dt: float) -> Motion:
    """Return the motion ``dt`` later on the quintic that ends at rest at ``goal`` after ``left``.

    Of all that begin as ``now`` it has the least integrated squared jerk (Flash & Hogan 1985), so
    one that is asked for anew in every tick, with the goal unchanged, stays on its curve.
    """
    T = max(left, LEAST_LEFT)
    s = min(dt / T, 1.0)
    motion = np.array((now.value, T * now.rate, T * T * now.acceleration, goal - now.value))
    powers = (
        (1.0, s, s**2, s**3, s**4, s**5),
        (0.0, 1.0, 2.0 * s, 3.0 * s**2, 4.0 * s**3, 5.0 * s**4),
        (0.0, 0.0, 2.0, 6.0 * s, 12.0 * s**2, 20.0 * s**3),
    )
    value, rate, acceleration = np.array(powers) @ QUINTIC @ motion
    return Motion(value, rate / T, acceleration / (T * T))


class Lift(NamedTuple):
    """Height of a foot over its way, by how much of the way is done: up, over, and softly down.

    Attributes
    ----------
    start, end:
        Height of the ground at both ends [m].
    clearance:
        How much higher the middle is [m].
    """

    start: float
    end: float
    clearance: float

    def at(self, s: float, rate: float) -> tuple[float, float, float]:
        """Return height [m], its rate and acceleration at the part ``s`` of the way.

        ``rate`` is that of s [1/s], taken as constant.
        """
        y, tilt = 4.0 * s * (1.0 - s), 4.0 * (1.0 - 2.0 * s)
        d, bump, n = self.end - self.start, self.clearance, STEEPNESS
        slope, curve = minimum_jerk_rates(s)
        # y^n is 1 in the middle; value, slope and curvature vanish at both ends.
        height = self.start + d * minimum_jerk(s) + bump * y**n
        slope = d * slope + bump * n * y ** (n - 1.0) * tilt
        bend = (n - 1.0) * y ** (n - 2.0) * tilt * tilt - 8.0 * y ** (n - 1.0)
        curve = d * curve + bump * n * bend
        return height, slope * rate, curve * rate * rate


class FootPose(NamedTuple):
    """Where a foot should be: position (3,), rotation (3, 3), twist and its derivative (6,)."""

    position: Array
    rotation: Array
    rate: Array
    acceleration: Array


@dataclass(frozen=True)
class SwingFoot:
    """A foot in the air.

    Attributes
    ----------
    level:
        x, y [m] and yaw [rad] as they should be.
    lifted_from:
        Height at which it left the ground [m].
    normal:
        (3,) of the ground, where the other foot stands.
    clearance:
        How high it is lifted [m].
    done:
        Part of the way that is done, in [0, 1].
    late:
        How long it should have been on the ground [s].
    descent:
        Speed at which it then goes on downwards [m/s].
    """

    level: Motion
    lifted_from: float
    normal: Array
    clearance: float
    descent: float
    done: float = 0.0
    late: float = 0.0

    def advanced(self, goal: Array, left: float, dt: float) -> SwingFoot:
        """Return it ``dt`` later on its way to ``goal`` (x, y, yaw); it lands after ``left``."""
        now = self.level
        x, y, yaw = goal.tolist()
        yaw = float(now.value[2]) + math.remainder(yaw - float(now.value[2]), math.tau)
        level = towards(now, np.array((x, y, yaw)), left, dt)
        if left <= 0.0:
            return replace(self, level=level, done=1.0, late=self.late + dt)
        done = min(1.0, self.done + (1.0 - self.done) * dt / left)
        return replace(self, level=level, done=done)

    def pose(self, ground: float, left: float) -> FootPose:
        """Return where it should be, if the ground below its goal is at height ``ground`` [m]."""
        level = self.level
        if self.late > 0.0:
            z, rate, acceleration = ground - self.descent * self.late, -self.descent, 0.0
        else:
            progress = (1.0 - self.done) / max(left, LEAST_LEFT)
            lift = Lift(self.lifted_from, ground, self.clearance)
            z, rate, acceleration = lift.at(self.done, progress)
        return FootPose(
            np.array((*level.value[:2], z)),
            upright_on(self.normal) @ turned(float(level.value[2])),
            np.array((*level.rate[:2], rate, 0.0, 0.0, level.rate[2])),
            np.array((*level.acceleration[:2], acceleration, 0.0, 0.0, level.acceleration[2])),
        )


def yaw_of(R: Array) -> float:
    """Return the heading [rad] of a frame's x axis."""
    return math.atan2(R[1, 0], R[0, 0])


def turned(yaw: float) -> Array:
    """Return the rotation (3, 3) about the vertical."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def upright_on(normal: Array) -> Array:
    """Return the shortest rotation (3, 3) that takes the vertical to a unit normal."""
    x, y, z = normal.tolist()
    a = 1.0 / (1.0 + z)
    return np.array(
        ((1.0 - a * x * x, -a * x * y, x), (-a * x * y, 1.0 - a * y * y, y), (-x, -y, z))
    )


def unit(vector: Array) -> Array:
    """Return the direction of a vector."""
    return np.asarray(vector / np.linalg.norm(vector))
