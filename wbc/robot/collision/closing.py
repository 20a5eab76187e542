"""How pairs of bodies that close are braked."""

from __future__ import annotations

from typing import NamedTuple


class Closing(NamedTuple):
    """How a pair that closes is braked: the inverse of the speed that a margin allows."""

    dt: float  # time for which a speed is held before braking begins [s]
    deceleration: float  # of the distance [m/s^2]
    gain: float  # largest fraction of the clearance to use up in one tick
    # Time that the slowest joint takes to stop, max |v| / a [s]; 0 if joints brake without limit.
    # A distance of Jacobian J closes at |J| |v| at most and is braked by |J| a: it takes no
    # longer than that joint.
    slowest: float = 0.0
