"""Margins that ask for no harder braking than a robot with finite torques is capable of.

At the velocity level a body in a margin may not come nearer from this tick on. Motors cannot do
that: such rows would contradict the torque bounds, and the tick would give up contacts for them. So
at the torque level what comes too fast is braked as hard as it can be, not at once.
"""

from __future__ import annotations

import numpy as np

from wbc.constraints.rows import Bounds
from wbc.native import lib
from wbc.validate import Array

# Hardest braking before a margin, and hardest way out of it [m/s^2].
MARGIN_BRAKING: float = lib.wbc_margin_braking


def reachable_rows(bounds: Bounds, v: Array, dt: float) -> Bounds:
    """Return rows of margins within reach of the velocity (nv,) now."""
    if not bounds.lower.size:
        return bounds
    change, push = MARGIN_BRAKING * dt, bounds.push
    if push is not None:
        push = push._replace(target=np.minimum(push.target, push.matrix @ v + change))
    lower = np.minimum(bounds.lower, bounds.matrix @ v + change)
    return bounds._replace(lower=lower, push=push)
