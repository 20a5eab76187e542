"""What the velocity at the end of a tick must keep: the limits' box, margins between capsules."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from tests.reference.state import AXES, Array, State

# Of margins: skin [m], deceleration [m/s^2], gain, recovery, its speed [m/s], interior.
SKIN, DECELERATION, GAIN, RECOVERY, BACK, INTERIOR, PART = 1e-4, 5.0, 0.5, 0.2, 0.1, 1e-3, 0.01
ARRIVAL, HARDER, HARDEST = 0.02, 2.0, 20.0  # torque level: s, of braking, m/s^2 at margins
LEAVING = 5.0  # rad/s^2 of each joint, out of margins at the torque level
GROWN = 1e-7  # m, by which a violation may grow in a tick


@dataclass(frozen=True)
class Limits:
    """Of the joints (nv - 6,); braking counts on the acceleration."""

    lower: Array
    upper: Array
    speed: Array
    acceleration: Array
    torque: Array


@dataclass(frozen=True)
class Pair:
    """Two capsules (joint, ends (2, 3) in its frame, radius) that keep a distance."""

    first: tuple[int, Array, float]
    second: tuple[int, Array, float]
    kept: float


class Cost(NamedTuple):
    """1/2 |weight (J x - target)|^2 + 1/2 damping |x|^2."""

    J: Array
    target: Array
    weight: float
    damping: Array | float = 0.0
    curvature: Array | float = 0.0


def stopping_speed(x: Array, a: Array | float, T: float) -> Array:
    """The largest u with u T + u^2 / (2 a) <= x, for x >= 0."""
    return a * (np.sqrt(T * T + 2.0 * x / a) - T)


def velocity_box(state: State, limits: Limits, dt: float) -> tuple[Array, Array, list[Cost]]:
    """Bounds on joint velocities by braking, speed and speeding up; a cost from outside."""
    q, a = state.q[7:], limits.acceleration
    ends = []
    for distance, towards in ((q - limits.lower, -state.v[6:]), (limits.upper - q, state.v[6:])):
        speed = np.minimum(stopping_speed(np.maximum(distance, 0.0), a, dt), limits.speed)
        if state.v.any():
            speed = np.minimum(speed, np.maximum(towards, 0.0) + a * dt)
        ends.append(speed)
    outside = np.minimum(q - limits.lower, 0.0) - np.minimum(limits.upper - q, 0.0)
    which = np.flatnonzero(np.abs(outside) > 1e-9)
    if not which.size:
        return -ends[0], ends[1], []
    back = np.clip(-RECOVERY / dt * outside, -limits.speed, limits.speed)[which]
    return -ends[0], ends[1], [Cost(np.eye(state.model.nv)[6 + which], back, 1.0)]


def arrival_box(state: State, limits: Limits, dt: float) -> tuple[Array, Array]:
    """Bounds v+ <= u(x - v dt) + (1 - dt/S) (v - u(x)) that torques can follow."""
    q, a = state.q[7:], limits.acceleration

    def u(x: Array) -> Array:
        inside = stopping_speed(np.maximum(x, 0.0), a, ARRIVAL)
        return np.clip(inside + np.minimum(x, 0.0) / ARRIVAL, -limits.speed, limits.speed)

    ends = []
    for x, v in ((q - limits.lower, -state.v[6:]), (limits.upper - q, state.v[6:])):
        most = u(x - v * dt) + (1.0 - dt / ARRIVAL) * (v - u(x))
        most = np.minimum(np.minimum(most, limits.speed), np.maximum(v, 0.0) + dt * a)
        ends.append(np.maximum(most, v - HARDER * dt * a))
    lower, upper = -ends[0], ends[1]
    middle = 0.5 * (lower + upper)
    return np.where(lower > upper, middle, lower), np.where(lower > upper, middle, upper)


def nearest(a: Array, b: Array) -> tuple[Array, Array]:
    """The nearest points of two segments (2, 3): of the interior, or of an end."""
    u, w = a[1] - a[0], b[1] - b[0]
    found = []
    system = np.array([[u @ u, -u @ w], [-u @ w, w @ w]])
    s, t = np.linalg.lstsq(system, np.array([u, -w]) @ (b[0] - a[0]), rcond=None)[0]
    if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
        found.append((a[0] + s * u, b[0] + t * w))
    for end in a:
        found.append((end, b[0] + np.clip((end - b[0]) @ w / (w @ w), 0.0, 1.0) * w))
    for end in b:
        found.append((a[0] + np.clip((end - a[0]) @ u / (u @ u), 0.0, 1.0) * u, end))
    return min(found, key=lambda pair: np.linalg.norm(pair[0] - pair[1]))


def clearances(state: State, pairs: list[Pair]) -> tuple[Array, Array]:
    """What is left of each pair's distance, skin included, and its derivative by v."""
    left, J = [], []
    for pair in pairs:
        both = (pair.first, pair.second)
        cores = [np.array([state.data.oMi[j].act(end) for end in ends]) for j, ends, _ in both]
        points = nearest(*cores)
        apart = points[0] - points[1]
        normal = apart / np.linalg.norm(apart)
        moved = []
        for (j, *_), point in zip(both, points, strict=True):
            own = pin.getJointJacobian(state.model, state.data, j, AXES)
            moved.append(own[:3] - pin.skew(point - state.data.oMi[j].translation) @ own[3:])
        left.append(np.linalg.norm(apart) - pair.first[2] - pair.second[2] - pair.kept - SKIN)
        J.append(normal @ (moved[0] - moved[1]))
    return np.array(left), np.array(J)


def margin_rows(
    state: State, pairs: list[Pair], limits: Limits, dt: float, torque: bool
) -> tuple[Array, Array, list[Cost]]:
    """J v+ >= least by braking, and a cost that moves out of margins what is inside."""
    x, J = clearances(state, pairs)
    able = np.abs(J[:, 6:]) @ (0.5 * limits.acceleration)
    braking = np.where(able > 1e-6, np.minimum(able, DECELERATION), DECELERATION)
    inside = np.maximum(x, 0.0)
    least = -np.minimum(stopping_speed(inside, braking, dt), GAIN / dt * inside)
    back = np.minimum(RECOVERY / dt * np.maximum(-SKIN - x, 0.0), BACK)
    pushed = back > 0.0
    reachable = J @ state.v + HARDEST * dt if torque else np.full(x.size, np.inf)
    least = np.where(pushed, -np.minimum(INTERIOR, PART * back), least)
    least = np.minimum(least, reachable)
    if not pushed.any():
        return J, least, []
    if torque:
        rate, change = J @ state.v, LEAVING * dt * np.sqrt(np.square(J[:, 6:]).sum(axis=1))
        back = np.minimum(back, np.minimum(reachable, np.maximum(rate, 0.0) + change))
        back = np.maximum(back, rate - change)
    return J, least, [Cost(J[pushed], back[pushed], 1.0)]


def cutting_planes(
    state: State, v: Array, pairs: list[Pair], dt: float
) -> tuple[Array, Array] | None:
    """Rows J v+ >= least, linear where v leads, of what would be violated there; None: nothing."""
    before, _ = clearances(state, pairs)
    there = State(state.model, pin.integrate(state.model, state.q, dt * v), v)
    after, J = clearances(there, pairs)
    which = after < np.minimum(-0.5 * SKIN, before - GROWN)
    if not which.any():
        return None
    lacking = (np.minimum(before, 0.0) - after)[which]
    return J[which], np.minimum(J[which] @ v + lacking / dt, 0.0)
