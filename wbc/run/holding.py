"""What held a tick back: inequality rows and bounds of joints that are active."""

from __future__ import annotations

import numpy as np

from wbc.controllers import Tick
from wbc.controllers.tick import ACTIVE, NEGLIGIBLE


def holding_rows(tick: Tick) -> tuple[str, ...]:
    """Return the labels of what held a command back: ``tick.active``, then joints at a bound.

    A joint is at a bound where a limit of its position, speed or acceleration decides its velocity,
    as in ``left_knee lower bound``.
    """
    if not tick.ok:
        return ()
    pull = tick.solution.z_box[: tick.velocity.size]
    least = max(NEGLIGIBLE, ACTIVE * float(np.abs(tick.solution.z_box).max(initial=0.0)))
    names = tick.qp.labels.variables
    held = np.flatnonzero(np.abs(pull) > least).tolist()
    bounds = (f"{names[k]} {'upper' if pull[k] > 0.0 else 'lower'} bound" for k in held)
    return (*tick.active, *bounds)
