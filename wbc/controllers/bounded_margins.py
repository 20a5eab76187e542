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

# Hardest braking before a margin [m/s^2], and of one joint on the way out of it [rad/s^2].
MARGIN_BRAKING: float = lib.wbc_margin_braking
MARGIN_LEAVING: float = lib.wbc_margin_leaving


def reachable_rows(bounds: Bounds, v: Array, dt: float) -> Bounds:
    """Return rows of margins within reach of the velocity (nv,) now."""
    if not bounds.lower.size:
        return bounds
    reach, push = bounds.matrix @ v + MARGIN_BRAKING * dt, bounds.push
    if push is not None:
        rate = push.matrix @ v
        change = MARGIN_LEAVING * dt * np.linalg.norm(push.matrix[:, 6:], axis=1)
        most = np.minimum(rate + MARGIN_BRAKING * dt, np.maximum(rate, 0.0) + change)
        push = push._replace(target=np.maximum(np.minimum(push.target, most), rate - change))
    return bounds._replace(lower=np.minimum(bounds.lower, reach), push=push)
