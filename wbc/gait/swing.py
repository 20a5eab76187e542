"""The swing foot's trajectory, whose goal and time of landing may change at any moment."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from wbc.gait.adaptation import Reach
from wbc.gait.crossing import Crossing
from wbc.minimum_jerk import minimum_jerk, minimum_jerk_rates
from wbc.rotations import upright_on
from wbc.validate import Array

# Shortest remaining time of a quintic [s].
LEAST_LEFT = 0.03
# Exponent of s (1 - s) in a foot's height, while it goes ahead with s^3: the less, the sooner it is
# above an edge just before its toe; at 2 and less its acceleration jumps.
STEEPNESS = 2.5

# A foot whose landing is put off may go so far past its goal [m], and come back.
PASSING = 0.02

# Acceleration of a late foot up to its descent speed [m/s^2]: with a jump in speed, arms were
# thrown up at their torque bounds in the last tick of most steps. A foot whose pace is outside
# USUAL_PACES, in a step made much shorter or longer, jumps all the same: pushed robots fell.
SPEED_UP = 6.0
USUAL_PACES = 0.5, 1.1


class SwingMotion(NamedTuple):
    """A value, its rate and acceleration: numbers all, or arrays (k,)."""

    value: Any
    rate: Any
    acceleration: Any

    @classmethod
    def rest(cls, value: float | Array) -> SwingMotion:
        """Return a constant value."""
        return SwingMotion(value, 0.0 * value, 0.0 * value)

    def plus(self, other: SwingMotion) -> SwingMotion:
        """Return the sum."""
        (x, v, a), (y, u, b) = self, other
        return SwingMotion(x + y, v + u, a + b)

    def minus(self, other: SwingMotion) -> SwingMotion:
        """Return the difference."""
        (x, v, a), (y, u, b) = self, other
        return SwingMotion(x - y, v - u, a - b)

    def spring_towards(self, goal: float | Array, rate: float, dt: float) -> SwingMotion:
        """Return it ``dt`` later, drawn to ``goal`` by a critically damped spring [rate: 1/s]."""
        acceleration = rate**2 * (goal - self.value) - 2.0 * rate * self.rate
        v = self.rate + acceleration * dt
        return SwingMotion(self.value + v * dt, v, acceleration)


Quintic = tuple[tuple[float, float, float], ...]


def towards(now: SwingMotion, goal: float | Array, left: float, dt: float) -> SwingMotion:
    """Return the motion ``dt`` later on the quintic that ends at rest at ``goal`` after ``left``.

    Of all that begin as ``now`` it has the least integrated squared jerk (Flash & Hogan 1985), so
    one that is asked for anew in every tick, with the goal unchanged, stays on its curve.
    """
    return _along(quintic(left, dt), now, goal)


def quintic(left: float, dt: float) -> Quintic:
    """Return the map (3, 3) from (goal - value, rate, acceleration) now to those after ``dt``.

    Its entries are Hermite polynomials of degree 5 and their derivatives: see :func:`towards`.
    """
    T = max(left, LEAST_LEFT)
    s = min(dt / T, 1.0)
    c, slope, bend = 1.0 - s, *minimum_jerk_rates(s)
    c2, Ts = c * c, T * s
    c3 = c2 * c
    return (
        (minimum_jerk(s), Ts * c3 * (1.0 + 3.0 * s), 0.5 * Ts * Ts * c3),
        (slope / T, c2 * (1.0 + 2.0 * s - 15.0 * s * s), 0.5 * Ts * c2 * (2.0 - 5.0 * s)),
        (bend / (T * T), -12.0 / T * s * c * (3.0 - 5.0 * s), c * (1.0 - 8.0 * s + 10.0 * s * s)),
    )


def _along(curves: Quintic, now: SwingMotion, goal: float | Array) -> SwingMotion:
    (x, v, a), distance = now, goal - now.value
    if isinstance(distance, float):  # called in every tick: arrays would cost more
        moved, rate, change = [p * distance + q * v + r * a for p, q, r in curves]
    else:
        moved, rate, change = np.array(curves).dot(np.array((distance, v, a)))
    return SwingMotion(x + moved, rate, change)


def _stopped(
    now: SwingMotion,
    goal: tuple[float, float, float],
    then: SwingMotion,
    left: float,
    dt: float,
    most: float,
) -> SwingMotion:
    """Return ``then``, the motion ``dt`` later, stopped sooner where it would pass the goal.

    A foot that is to land at once and then is given time, as the DCM turns back, would follow its
    minimum-jerk curve to the other side of the standing foot, and come back: legs were crossed so.
    """
    (x, y, *_), (vx, vy, *_), (ax, ay, *_) = [one.tolist() for one in now]
    gx, gy, yaw = goal
    c, s = math.cos(yaw), math.sin(yaw)
    for ex, ey in ((c, s), (-s, c)):  # ahead, aside
        d, v, a = ex * (gx - x) + ey * (gy - y), ex * vx + ey * vy, ex * ax + ey * ay
        end = _stopping_time(d, v, a, left, most)
        if end < left:
            along, direction = SwingMotion(0.0, v, a), np.array((ex, ey, 0.0, 0.0, 0.0))
            sooner = towards(along, d, end, dt).minus(towards(along, d, left, dt))
            then = then.plus(SwingMotion(*(part * direction for part in sooner)))
    return then


def _stopping_time(d: float, v: float, a: float, left: float, most: float) -> float:
    """Return the time [s], at most ``left``, within which a foot stops at a distance ``d``.

    The slope of a minimum-jerk curve just before its end is proportional to
    30 d - 12 v T - 1.5 a T^2: with the least T of no slope it does not pass its goal, for v > 0.
    """
    if v < 0.0:
        d, v, a = -d, -v, -a
    room = max(d, 0.0) + PASSING
    inside = 144.0 * v * v + 180.0 * a * room
    if inside < 0.0:
        return left  # it is slowed down enough
    straight = 60.0 * room / max(12.0 * v + math.sqrt(inside), 1e-9)
    if straight >= left:
        return left
    return min(left, max(straight, Reach((0.0, 0.0), (v, 0.0), most).min_time((d, 0.0), (d, 0.0))))


class Lift(NamedTuple):
    """Height of a foot by the part of its path that is done.

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
        """Return the height [m], its rate and acceleration at the part ``s`` of the path.

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
    """Reference of a foot: position (3,), rotation (3, 3), twist and its derivative (6,)."""

    position: Array
    rotation: Array
    rate: Array
    acceleration: Array


LEVEL = SwingMotion(0.0, 0.0, 0.0)


class SwingFoot(NamedTuple):
    """A swing foot.

    Its height follows :class:`Lift`. In a shortened step the clearance falls with the square of the
    time, so that the upward acceleration is no larger than in a nominal one: it would throw the CoM
    up, and the foot would land late. When the plan changes the height does not jump: its offset
    from the new curve decays on a minimum-jerk curve until touch-down.

    Attributes
    ----------
    level:
        Reference of x, y [m], yaw [rad] and the horizontal part of the sole's unit normal (5,).
    height:
        Reference of the height [m].
    lifted_from:
        Height at lift-off [m].
    normal:
        (3,) of the ground where it lands, a unit vector.
    clearance:
        How high it is lifted in the ``usual`` time [m].
    usual:
        Nominal swing time [s].
    descent:
        Speed at which it goes on downwards when late [m/s].
    done:
        Part of the path that is done, in [0, 1].
    pace:
        Rate of ``done``, by the nominal one.
    late:
        Time since the planned touch-down [s].
    crossing:
        Path over edges, if any are known.
    tip:
        Pitch of the foot over them, toe down [rad].
    """

    level: SwingMotion
    height: SwingMotion
    lifted_from: float
    normal: Array
    clearance: float
    usual: float
    descent: float
    done: float = 0.0
    pace: float = 1.0
    late: float = 0.0
    crossing: Crossing | None = None
    tip: SwingMotion = LEVEL

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

        ``sole`` is its normal (3,) there, if it differs from that of the landing.
        """
        level = SwingMotion.rest(np.append(pose, (normal if sole is None else sole)[:2]))
        still = SwingMotion.rest(height)
        return cls(level, still, height, normal, clearance, usual, descent, crossing=crossing)

    def advance(
        self,
        goal: tuple[float, float, float],
        ground: float,
        left: float,
        dt: float,
        most: float,
    ) -> SwingFoot:
        """Return the foot ``dt`` later; it lands at ``goal`` (x, y, yaw) after ``left`` [s].

        ``ground`` is the height below the goal [m], ``most`` the largest acceleration of a foot
        that stops before it passes the goal [m/s^2].
        """
        level, rate, crossing = self.level, (1.0 - self.done) / max(left, dt), self.crossing
        (x, y, yaw), heading = goal, level.value.item(2)
        yaw = heading + math.remainder(yaw - heading, math.tau)
        end = np.array((x, y, yaw, *self.normal[:2].tolist()))
        curves = quintic(left, dt)
        if crossing is None:
            level = _stopped(self.level, goal, _along(curves, level, end), left, dt, most)
        elif self.done >= crossing.begins:
            level = towards(level, end, left - crossing.ends / rate if rate else 0.0, dt)
        done, pace, late, tip = 1.0, self.pace, self.late + dt, self.tip
        if left > 0.0:
            done, late = min(1.0, self.done + rate * dt), self.late
            pace = rate * self.usual if left >= dt else pace
        if crossing is not None:
            tip = SwingMotion(*crossing.pitch_at(done, rate))
        before = self._curve(ground, rate, self.done, self.pace, self.late)
        offset = _along(curves, self.height.minus(before), 0.0)
        height = offset.plus(self._curve(ground, rate, done, pace, late))
        return self._replace(level=level, height=height, done=done, pace=pace, late=late, tip=tip)

    def _curve(
        self, ground: float, rate: float, done: float, pace: float, late: float
    ) -> SwingMotion:
        """Return the nominal height at a ``rate`` of ``done`` [1/s]; 0 if the foot is late."""
        if rate == 0.0:
            if not USUAL_PACES[0] <= pace <= USUAL_PACES[1]:
                return SwingMotion(ground - self.descent * late, -self.descent, 0.0)
            speeding = min(late, self.descent / SPEED_UP)
            v = SPEED_UP * speeding
            distance = 0.5 * v * speeding + v * (late - speeding)
            return SwingMotion(ground - distance, -v, -SPEED_UP if v < self.descent else 0.0)
        if self.crossing is not None:
            return SwingMotion(*self.crossing._replace(end=ground).height_at(done, rate))
        clearance = self.clearance * min(1.0, 1.0 / (rate * self.usual)) ** 2
        return SwingMotion(*Lift(self.lifted_from, ground, clearance).at(done, rate))

    def pose(self) -> FootPose:
        """Return the foot's reference; rates are of first order in its tilt."""
        (x, y, yaw, nx, ny), v, a = [one.tolist() for one in self.level]
        (z, lift_rate, lift_acceleration), (tip, *tip_rates) = self.height, self.tip
        R = turned(yaw)
        if nx or ny:
            R = upright_on(np.array((nx, ny, math.sqrt(1.0 - nx * nx - ny * ny)))) @ R
        twist = np.array((v[0], v[1], lift_rate, -v[4], v[3], v[2]))
        twist_rate = np.array((a[0], a[1], lift_acceleration, -a[4], a[3], a[2]))
        if tip:
            twist[3:] += tip_rates[0] * R[:, 1]
            twist_rate[3:] += tip_rates[1] * R[:, 1]
            c, s = math.cos(tip), math.sin(tip)
            R = R @ np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))
        return FootPose(np.array((x, y, z)), R, twist, twist_rate)


def yaw_of(R: Array) -> float:
    """Return the heading [rad] of a frame's x axis."""
    return math.atan2(R[1, 0], R[0, 0])


def turned(yaw: float) -> Array:
    """Return the rotation (3, 3) about the vertical."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def unit(vector: Array) -> Array:
    """Return the direction of a vector."""
    return np.asarray(vector / np.linalg.norm(vector))
