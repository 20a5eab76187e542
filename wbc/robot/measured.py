"""Checks on a measured configuration. They run at every tick, so they are kept cheap."""

from __future__ import annotations

import math

from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.robot.limits import BASE_NQ, Limits
from wbc.validate import Array, finite_vector

UNIT = 1e-3  # how far the norm of a measured quaternion may be from 1


def checked_configuration(q: ArrayLike, nq: int, limits: Limits) -> Array:
    """Return ``q`` as a fresh (nq,) array with quaternion (and cos, sin) normalised.

    Raises
    ------
    InvalidInputError
        Wrong size, not finite, or a norm further than 1e-3 from 1: not rounding, but another order
        or a wrong slice.
    """
    array = finite_vector("q", q, nq)
    _normalise(array[3:BASE_NQ], "quaternion q[3:7] (order x, y, z, w)")
    for k in limits.unbounded:
        start = limits.starts[k]
        _normalise(array[start : start + 2], f"(cos, sin) of joint {limits.names[k]!r}")
    return array


def _normalise(part: Array, what: str) -> None:
    norm = math.sqrt(part.dot(part))
    if abs(norm - 1.0) > UNIT:
        raise InvalidInputError(f"{what} has norm {norm:.6g}, expected 1; normalise it")
    if norm != 1.0:
        part /= norm
