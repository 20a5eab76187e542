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


class SwingMotion(NamedTuple):
    """Values (k,), their rates and accelerations."""

    value: Array
    rate: Array
    acceleration: Array

    @classmethod
    def rest(cls, value: Array) -> Self:
        """Return no motion at all."""
        return cls(value, np.zeros_like(value), np.zeros_like(value))

    def plus(self, other: SwingMotion) -> SwingMotion:
        """Return the sum of both."""
        return SwingMotion(*(mine + its for mine, its in zip(self, other, strict=True)))

    def less(self, other: SwingMotion) -> SwingMotion:
        """Return what it is beyond the other."""
        return SwingMotion(*(mine - its for mine, its in zip(self, other, strict=True)))

    def sprung(self, goal: float, rate: float, dt: float) -> Self:
        """Return it ``dt`` later on a critically damped spring to ``goal`` of ``rate`` [1/s]."""
        acceleration = rate**2 * (goal - self.value) - 2.0 * rate * self.rate
        v = self.rate + acceleration * dt
        return type(self)(self.value + v * dt, v, acceleration)


def towards(now: SwingMotion, goal: Array, left: float, dt: float) -> SwingMotion:
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
    return SwingMotion(value, rate / T, acceleration / (T * T))


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

    It is lifted by the part of its way that is done (:class:`Lift`); a hurried one less, by the
    square of its time, so that it is accelerated upwards no more than in a usual step: that throws
    the CoM up, and the foot lands late. Where the plan changes, the height does not jump: what it
    is off its new curve is taken back on a curve of least jerk until the landing.

    Attributes
    ----------
    level:
        x, y [m] and yaw [rad] as they should be.
    height:
        (1,) likewise [m].
    lifted_from:
        Height at which it left the ground [m].
    normal:
        (3,) of the ground, where the other foot stands.
    clearance:
        How high it is lifted in the ``usual`` time [m].
    usual:
        Time in the air [s].
    descent:
        Speed at which it goes on downwards when it is late [m/s].
    done:
        Part of the way that is done, in [0, 1].
    late:
        How long it should have been on the ground [s].
    """

    level: SwingMotion
    height: SwingMotion
    lifted_from: float
    normal: Array
    clearance: float
    usual: float
    descent: float
    done: float = 0.0
    late: float = 0.0

    @classmethod
    def begun(
        cls,
        pose: Array,
        height: float,
        normal: Array,
        clearance: float,
        usual: float,
        descent: float,
    ) -> Self:
        """Return one that leaves the ground, from ``pose`` (x, y, yaw)."""
        still = SwingMotion.rest(np.array((height,)))
        return cls(SwingMotion.rest(pose), still, height, normal, clearance, usual, descent)

    def advanced(self, goal: Array, ground: float, left: float, dt: float) -> SwingFoot:
        """Return it ``dt`` later on its way to ``goal`` (x, y, yaw); it lands after ``left``.

        ``ground`` is the height below the goal [m].
        """
        now = self.level
        x, y, yaw = goal.tolist()
        yaw = float(now.value[2]) + math.remainder(yaw - float(now.value[2]), math.tau)
        level = towards(now, np.array((x, y, yaw)), left, dt)
        rate = (1.0 - self.done) / max(left, dt)
        if left <= 0.0:
            then = replace(self, level=level, done=1.0, late=self.late + dt)
        else:
            then = replace(self, level=level, done=min(1.0, self.done + rate * dt))
        curve, later = self._curve(ground, rate), then._curve(ground, rate)
        off = towards(self.height.less(curve), np.zeros(1), left, dt)
        return replace(then, height=off.plus(later))

    def _curve(self, ground: float, rate: float) -> SwingMotion:
        """Return the height (1,) of one that does its way at ``rate`` [1/s]; 0 if it is late."""
        if rate == 0.0:
            below = ground - self.descent * self.late
            return SwingMotion(np.array((below,)), np.array((-self.descent,)), np.zeros(1))
        clearance = self.clearance * min(1.0, 1.0 / (rate * self.usual)) ** 2
        lift = Lift(self.lifted_from, ground, clearance).at(self.done, rate)
        return SwingMotion(*(np.array((one,)) for one in lift))

    def pose(self) -> FootPose:
        """Return where it should be."""
        level, (z, rate, acceleration) = self.level, (float(one[0]) for one in self.height)
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
