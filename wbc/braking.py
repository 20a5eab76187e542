"""From which speed one can still stop: the distance that braking takes in discrete time."""

from __future__ import annotations

import numpy as np

from wbc.validate import Array


def stopping_speed(distance: Array, deceleration: Array | float, dt: float) -> Array:
    """Return the largest speed u with ``u dt + u^2 / (2 deceleration) <= distance``.

    The speed is held for one tick ``dt`` [s], then braked. The positive root of the quadratic in
    the form without cancellation; arrays broadcast.

    Parameters
    ----------
    distance:
        Left to the limit, >= 0 [m or rad].
    deceleration:
        > 0, in the same unit per s^2.
    """
    slowing = distance * (0.5 / deceleration)
    slowing += 0.25 * dt * dt
    np.sqrt(slowing, out=slowing)
    slowing += 0.5 * dt
    return np.divide(distance, slowing, out=slowing)
