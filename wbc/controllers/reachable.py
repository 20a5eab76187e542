"""Limits and margins that ask for no harder braking than a robot with finite torques is capable of.

At the velocity level a joint that meets its range too fast is stopped at once, and a body in a
margin may not come nearer from this tick on. Motors cannot do that: such rows would contradict the
torque bounds, and the tick would give up contacts for them. So at the torque level what comes too
fast is braked as hard as it can be, not at once.
"""

from __future__ import annotations

import numpy as np

from wbc.braking import stopping_speed
from wbc.constraints.limits import FAR, Box, Limits
from wbc.constraints.rows import Bounds
from wbc.robot import Snapshot
from wbc.robot.limits import BASE_NV
from wbc.validate import Array

# What limits ask of a joint beyond the braking that they count on, by that: the reserve.
BRAKING = 2.0
# Joints come to their limits as exp(-t / ARRIVAL) at the end [s], and what they are too fast by
# goes as exp(-t / SETTLE).
ARRIVAL = SETTLE = 0.02
# Hardest braking before a margin, and hardest way out of it [m/s^2].
MARGIN_BRAKING = 20.0


def arrival_box(limits: Limits, snapshot: Snapshot, deceleration: Array, dt: float) -> Box:
    """Return bounds (nv,), (nv,) on v+ that let joints arrive at their limits without chatter.

    The velocity level's box (:meth:`~wbc.constraints.Limits.box`) asks for a joint's braking speed
    in one tick, and for all that is left at the end of it: gains of 1/dt on measured velocities and
    1/dt^2 on positions, by which what motion and contacts leave comes back as forces. With the
    distance x left and the rate u(x) from which a joint stops, u T + u^2 / (2 a) = x (x / T
    outside), the bound here is

        v+ <= u(x - v dt) + (1 - dt / S) (v - u(x)).

    A joint at u(x) stays there, braking by less than a; what it is faster by is lost with the time
    constant S, and what lies outside comes back with T: one law, without a switch.

    Parameters
    ----------
    deceleration:
        (nv - 6,) that braking counts on [rad/s^2 or m/s^2]; no more than ``BRAKING`` times that is
        asked for.
    """
    v, wait = snapshot.v[BASE_NV:], max(ARRIVAL, dt)
    towards = np.stack((-v, v))
    distance = np.minimum(limits.signed_distance(snapshot), FAR)
    now = _braking_speed(distance, limits.speed, deceleration, wait)
    later = _braking_speed(distance - dt * towards, limits.speed, deceleration, wait)
    most = later + max(0.0, 1.0 - dt / SETTLE) * (towards - now)
    most = np.where(distance < FAR, most, limits.speed)
    # Far from limits it is the motors that bound how fast a joint speeds up.
    faster = towards if limits.braking == "bounded" else np.maximum(towards, 0.0)
    np.minimum(most, limits.speed, out=most)
    np.minimum(most, faster + dt * limits.acceleration, out=most)
    np.maximum(most, towards - BRAKING * dt * deceleration, out=most)
    lower, upper = -most[0], most[1]
    crossed = lower > upper
    if crossed.any():  # both sides contradict: between them
        lower[crossed] = upper[crossed] = 0.5 * (lower[crossed] + upper[crossed])
    return np.concatenate((-limits.base_twist, lower)), np.concatenate((limits.base_twist, upper))


def _braking_speed(distance: Array, most: Array, deceleration: Array, wait: float) -> Array:
    speed = stopping_speed(np.maximum(distance, 0.0), deceleration, wait)
    speed += np.minimum(distance, 0.0) / wait
    clipped: Array = np.minimum(np.maximum(speed, -most), most)
    return clipped


def reachable_rows(bounds: Bounds, v: Array, dt: float) -> Bounds:
    """Return rows of margins within reach of the velocity (nv,) now."""
    if not bounds.lower.size:
        return bounds
    change, push = MARGIN_BRAKING * dt, bounds.push
    if push is not None:
        push = push._replace(target=np.minimum(push.target, push.matrix @ v + change))
    lower = np.minimum(bounds.lower, bounds.matrix @ v + change)
    return bounds._replace(lower=lower, push=push)
