"""The CoM's way on which a robot's feet can push: the scaled human's, moved as little as needed.

Over level ground the CoP p, CoM c and angular momentum k satisfy (with f = m (c'' + g))

    c - p = h/(g + z'') c'' + n x k'/f_z ,

so a CoP that is moved by d moves the CoM by e with e - h/(g + z'') e'' = d. That is solved over the
whole motion at once, one tridiagonal system for x and for y; where the motion begins and ends,
which nothing says, so that the CoM is moved least. No step is planned anew, none is lost.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from wbc.errors import InvalidInputError
from wbc.gait.legs import SIDES
from wbc.minimum_jerk import minimum_jerk
from wbc.motion.dropouts import runs
from wbc.polygon import convex_hull, inset, nearest_point
from wbc.validate import Array

# The CoP's distance from the edge of the soles, as a part of the smaller sole's length.
INSIDE = 0.07
LEAST_GRAVITY = 2.0  # m/s^2: below it, in the air or nearly so, there is no CoP


def loads(flags: NDArray[np.bool_]) -> Array:
    """Return which part of the weight each foot bears (n, 2), by the contacts alone.

    In double support it goes over from the foot that stood before to the one that stands after on
    a curve of least jerk; where both stood before or stand after, the middle is theirs. In the air
    it is halved.
    """
    count, both = len(flags), flags[:, 0] & flags[:, 1]
    left = np.where(flags[:, 0] == flags[:, 1], 0.5, flags[:, 0].astype(float))
    for first, end in runs(both):
        start = left[first - 1] if first > 0 else 0.5
        goal = left[end] if end < count else 0.5
        u = (np.arange(first, end) - first + 1.0) / (end - first + 1.0)
        left[first:end] = start + (goal - start) * minimum_jerk(u)
    return np.column_stack((left, 1.0 - left))


def cop_of(com: Array, k_rate: Array, mass: float, gravity: float, dt: float) -> tuple[Array, ...]:
    """Return the CoP (n, 2) that a motion of the CoM (n, 3) over ground at 0 asks for, and more.

    Returns
    -------
    tuple
        The CoP [m], NaN where the ground hardly pushes, and h/(g + z'') (n,) [s^2].
    """
    acceleration = np.gradient(np.gradient(com, dt, axis=0), dt, axis=0)
    up = gravity + acceleration[:, 2]
    pushed = up > LEAST_GRAVITY
    up = np.maximum(up, LEAST_GRAVITY)
    square = com[:, 2] / up
    moment = np.column_stack((-k_rate[:, 1], k_rate[:, 0])) / (mass * up)[:, None]
    cop = com[:, :2] - square[:, None] * acceleration[:, :2] + moment
    cop[~pushed] = np.nan
    return cop, square


def clipped(
    cop: Array, corners: Mapping[str, Array], flags: NDArray[np.bool_], share: float = INSIDE
) -> Array:
    """Return the nearest CoP (n, 2) inside the soles that stand; NaN stays, and where none does.

    Parameters
    ----------
    corners:
        Of the soles (n, k, 2), by side [m].
    flags:
        Which stand (n, 2).
    """
    found = np.full_like(cop, np.nan)
    known = dict[bytes, Array]()
    for k, point in enumerate(cop):
        stand = [corners[side][k] for side, on in zip(SIDES, flags[k], strict=True) if on]
        if not stand or not np.isfinite(point).all():
            continue
        points = np.concatenate(stand)
        key = np.round(points, 6).tobytes()
        if key not in known:
            known[key] = _shrunk(points, stand, share)
        found[k] = nearest_point(known[key], point)
    return found


def moved(shift: Array, square: Array, dt: float) -> Array:
    """Return how the CoM has to move (n, 2) for its CoP to be shifted so (n, 2) [m].

    Parameters
    ----------
    shift:
        NaN where nothing is wanted, where it is interpolated.
    square:
        h/(g + z'') (n,) [s^2].
    """
    count, frames = len(shift), np.arange(len(shift))
    s = square / dt**2
    s[[0, -1]] = 0.0
    bands = np.zeros((3, count))
    bands[0, 1:], bands[1], bands[2, :-1] = -s[:-1], 1.0 + 2.0 * s, -s[1:]
    ends = np.zeros((count, 2))
    ends[0, 0] = ends[-1, 1] = 1.0
    ends = solve_banded((1, 1), bands, ends)  # what values at both ends add
    found = np.zeros((count, 2))
    for axis in range(2):
        known = np.isfinite(shift[:, axis])
        if not known.any():
            continue
        wanted = np.interp(frames, frames[known], shift[known, axis])
        wanted[[0, -1]] = 0.0
        own = solve_banded((1, 1), bands, wanted)
        found[:, axis] = own - ends @ np.linalg.lstsq(ends, own, rcond=None)[0]
    return found


def _shrunk(points: Array, stand: list[Array], share: float) -> Array:
    """Return the hull of soles, less a margin by the narrowest of them."""
    hull = convex_hull(points)
    while share > 1e-3:
        try:
            return inset(hull, share * min(float(np.ptp(one, axis=0).max()) for one in stand))
        except InvalidInputError:  # feet on their edges leave a narrow strip, or a line
            share *= 0.5
    return hull
