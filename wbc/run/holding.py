"""What held a tick back: inequality rows and bounds of joints that are active."""

from __future__ import annotations

from typing import NamedTuple

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
    return (*tick.active, *(f"{name} {side} bound" for name, side, _ in held_joints(tick)))


class HeldJoint(NamedTuple):
    """A joint at a bound of its velocity, ``lower`` or ``upper``, and the bound's multiplier."""

    name: str
    side: str
    pull: float


def held_joints(tick: Tick) -> list[HeldJoint]:
    """Return the joints whose velocity a bound holds back, in the robot's order; none if failed."""
    if not tick.ok:
        return []
    pull = tick.solution.z_box[: tick.velocity.size]
    least = max(NEGLIGIBLE, ACTIVE * float(np.abs(tick.solution.z_box).max(initial=0.0)))
    names = tick.qp.labels.variables
    return [
        HeldJoint(names[k], "upper" if pull[k] > 0.0 else "lower", abs(float(pull[k])))
        for k in np.flatnonzero(np.abs(pull) > least).tolist()
    ]
