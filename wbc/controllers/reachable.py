"""Limits and margins that ask for no harder braking than a robot with finite torques is capable of.

At the velocity level a joint that meets its range too fast is stopped at once, and a body in a
margin may not come nearer from this tick on. Motors cannot do that: such rows would contradict the
torque bounds, and the tick would give up contacts for them. So at the torque level what comes too
fast is braked as hard as it can be, not at once.
"""

from __future__ import annotations

import numpy as np

from wbc.constraints.rows import Bounds
from wbc.controllers.levels import Box
from wbc.laws import Rows
from wbc.robot.limits import BASE_NV
from wbc.validate import Array

# What limits ask of a joint beyond the braking that they count on, by that: the reserve.
BRAKING = 2.0
# Hardest braking before a margin, and hardest way out of it [m/s^2].
MARGIN_BRAKING = 20.0


def reachable_limits(
    box: Box, recovery: Rows | None, v: Array, acceleration: Array, dt: float
) -> tuple[Box, Rows | None]:
    """Return bounds on v+, and what moves joints back into range, within reach of v (nv,) now.

    Parameters
    ----------
    acceleration:
        (nv - 6,) that the limits count on [rad/s^2 or m/s^2].
    """
    joints, change = v[BASE_NV:], acceleration * (BRAKING * dt)
    if recovery is not None:
        reach = np.abs(recovery.matrix[:, BASE_NV:])
        # Joints without effort limit may accelerate without end, and 0 times infinity is NaN.
        step = np.multiply(reach, change, out=np.zeros_like(reach), where=reach > 0.0).sum(axis=1)
        now = recovery.matrix @ v
        recovery = recovery._replace(target=np.clip(recovery.target, now - step, now + step))
    lower, upper = box[0].copy(), box[1].copy()
    np.minimum(lower[BASE_NV:], joints + change, out=lower[BASE_NV:])
    np.maximum(upper[BASE_NV:], joints - change, out=upper[BASE_NV:])
    return (lower, upper), recovery


def reachable_rows(bounds: Bounds, v: Array, dt: float) -> Bounds:
    """Return rows of margins within reach of the velocity (nv,) now."""
    if not bounds.lower.size:
        return bounds
    change, push = MARGIN_BRAKING * dt, bounds.push
    if push is not None:
        push = push._replace(target=np.minimum(push.target, push.matrix @ v + change))
    lower = np.minimum(bounds.lower, bounds.matrix @ v + change)
    return bounds._replace(lower=lower, push=push)
