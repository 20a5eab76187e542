"""The CoM's way on which a robot's feet can push: the scaled human's, moved as little as needed.

Over level ground the CoP p, CoM c and angular momentum k satisfy (with f = m (c'' + g))

    c - p = h/(g + z'') c'' + n x k'/f_z ,

so a CoM that is moved by e moves its CoP by e - h/(g + z'') e''. The CoP has room inside the soles:
of all ways with CoPs in there the CoM's is the one nearest to the human's, over the whole motion at
once. No step is planned anew, none is lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded, solveh_banded

from wbc.errors import InvalidInputError
from wbc.gait.legs import SIDES
from wbc.minimum_jerk import minimum_jerk
from wbc.motion.dropouts import runs
from wbc.polygon import convex_hull, inset, nearest_point
from wbc.validate import Array

# The CoP's distance from the edge of the soles, as a part of the smaller sole's length.
INSIDE = 0.05
STRIP = 0.3  # of their width that is left out at each side of what is narrower than that
# By displacements of the CoM: those of the CoP, and what is outside the soles; rounds of Newton's.
SHIFTED, OUTSIDE, NEWTON = 1e-3, 1e3, 12
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


@dataclass(frozen=True, eq=False)
class SupportedFrames:
    """What some frames stand on.

    Attributes
    ----------
    frames:
        Numbers of the frames.
    feet:
        0 for the left one, 1 for the right one, by the foot that stands; corners that touch
        (k, 3) [m].
    """

    frames: NDArray[np.intp]
    feet: tuple[tuple[int, Array], ...]

    @cached_property
    def polygon(self) -> Array:
        """Convex hull of the corners (k, 2), anticlockwise."""
        return convex_hull(np.concatenate([corners[:, :2] for _, corners in self.feet]))

    @cached_property
    def inner(self) -> Array:
        """The same less a margin by the narrowest of the soles."""
        hull = self.polygon
        narrow = min(float(np.ptp(corners[:, :2], axis=0).max()) for _, corners in self.feet)
        edges = np.roll(hull, -1, axis=0) - hull
        normals = edges[:, ::-1] * [1.0, -1.0] / np.linalg.norm(edges, axis=1)[:, None]
        width = float(np.ptp(hull @ normals.T, axis=0).min()) if len(hull) > 2 else 0.0
        margin = min(INSIDE * narrow, STRIP * width)
        if margin < 1e-3 * narrow:  # a foot on its edge leaves a line
            return hull
        try:
            return inset(hull, margin)
        except InvalidInputError:  # a thin triangle
            return hull

    @cached_property
    def edges(self) -> Array:
        """Outward normals and offsets (m, 3) of the same."""
        at = hull = self.inner
        ways = np.roll(hull, -1, axis=0) - hull
        normals = ways[:, ::-1] * [1.0, -1.0] / np.linalg.norm(ways, axis=1)[:, None]
        if len(hull) == 2:  # a foot on its edge
            along = ways[0] / np.linalg.norm(ways[0])
            normals, at = np.vstack((normals, along, -along)), np.vstack((hull, hull[[1, 0]]))
        return np.column_stack((normals, (normals * at).sum(axis=1)))


def supports(corners: Mapping[str, Array], flags: NDArray[np.bool_]) -> tuple[SupportedFrames, ...]:
    """Return what frames stand on, those that stand on the same together; none in the air.

    Parameters
    ----------
    corners:
        Of the soles that touch (n, k, 3), by side [m].
    flags:
        Which stand (n, 2).
    """
    shapes = [np.round(corners[side].reshape(len(flags), -1), 6) for side in SIDES]
    keys = np.hstack((flags, *(np.where(flags[:, [n]], one, 0.0) for n, one in enumerate(shapes))))
    alike = dict[bytes, list[int]]()
    for k in np.flatnonzero(flags.any(axis=1)).tolist():
        alike.setdefault(keys[k].tobytes(), []).append(k)
    return tuple(
        SupportedFrames(
            np.array(frames),
            tuple((n, corners[s][frames[0]]) for n, s in enumerate(SIDES) if flags[frames[0], n]),
        )
        for frames in alike.values()
    )


def clipped(cop: Array, stands: Sequence[SupportedFrames], *, edge: bool = False) -> Array:
    """Return the nearest CoP (n, 2) on the soles that stand; NaN stays, and where none does.

    Inside their margin, or with ``edge`` up to their edges.
    """
    found = np.full_like(cop, np.nan)
    every = [(one.frames, one.polygon if edge else one.inner) for one in stands]
    for own in ([s for s in every if (len(s[1]) > 2) == wide] for wide in (True, False)):
        if not own:
            continue
        # All frames at once: hulls with fewer corners have their last one several times.
        most = max(len(hull) for _, hull in own)
        hulls = [np.vstack((hull, *[hull[-1:]] * (most - len(hull)))) for _, hull in own]
        frames = np.concatenate([one for one, _ in own])
        each = np.repeat(np.stack(hulls), [len(one) for one, _ in own], axis=0)
        found[frames] = nearest_point(each, cop[frames])
    return found


def least_moved(
    cop: Array, square: Array, dt: float, stands: Sequence[SupportedFrames]
) -> tuple[Array, Array]:
    """Return how the CoM has to move (n, 2) at least for its CoP to be inside the soles [m].

    The least squares of the CoM's displacements and, by less, of the CoP's; what is left outside
    counts much more, so that what cannot be is nearly met. Newton's method on the edges that are
    passed, a band of x and y of five frames.

    Parameters
    ----------
    cop:
        That it would have (n, 2) [m]; NaN where the ground hardly pushes.
    square:
        h/(g + z'') (n,) [s^2].

    Returns
    -------
    tuple
        That, and where the CoP then is.
    """
    count = len(cop)
    edges = _edges(stands, count)
    edges[~np.isfinite(cop).all(axis=1)] = 0.0
    edges[[0, -1]] = 0.0  # where the motion begins and ends nothing is known
    ways = _ways(square, dt)
    off: Array = np.zeros((count, 2))
    start, pressed = np.nan_to_num(cop), np.zeros(edges.shape[:2], dtype=bool)
    for number in range(NEWTON):
        now = start + _pressing(ways, off)
        past = (edges[..., :2] @ now[..., None])[..., 0] - edges[..., 2]
        if np.array_equal(past > 0.0, pressed) and number > 0:
            break
        pressed = past > 0.0
        normals = np.where(pressed[..., None], edges[..., :2], 0.0)
        H = OUTSIDE * np.swapaxes(normals, 1, 2) @ normals + SHIFTED * np.eye(2)
        base = (edges[..., :2] @ start[..., None])[..., 0] - edges[..., 2]
        slope = OUTSIDE * (np.swapaxes(normals, 1, 2) @ base[..., None])[..., 0]
        off = _least(ways, H, slope)
    return off, cop + _pressing(ways, off)


def _edges(stands: Sequence[SupportedFrames], count: int) -> Array:
    """Return outward normals and offsets (n, m, 3) of what frames stand on; zeros fill them up."""
    found = np.zeros((count, max((len(one.edges) for one in stands), default=0), 3))
    for one in stands:
        found[one.frames, : len(one.edges)] = one.edges
    return found


def pressing(off: Array, square: Array, dt: float) -> Array:
    """Return the displacements (n, 2) of the CoP for those of the CoM (n, 2)."""
    return _pressing(_ways(square, dt), off)


def _ways(square: Array, dt: float) -> Array:
    """Return how a frame's CoP hangs on the CoM before, in and after it (n, 3)."""
    s = square / dt**2
    s[[0, -1]] = 0.0
    return np.column_stack((-s, 1.0 + 2.0 * s, -s))


def _pressing(ways: Array, off: Array) -> Array:
    found = ways[:, 1:2] * off
    found[1:] += ways[1:, :1] * off[:-1]
    found[:-1] += ways[:-1, 2:] * off[1:]
    return found


def _least(ways: Array, H: Array, slope: Array) -> Array:
    """Return what minimises |e|^2/2 + sum_k p_k' H_k p_k/2 + slope_k' p_k, p by ``ways`` of e."""
    count = len(ways)
    band, right = np.zeros((6, count, 2)), np.zeros((count + 2, 2))
    band[0] += 1.0
    for a in range(3):
        right[a : count + a] += ways[:, a : a + 1] * slope
        for b in range(a, 3):
            block = (ways[:, a] * ways[:, b])[:, None, None] * H
            # Column of frame k + a - 1, row of frame k + b - 1: number 2 (b - a) + j - i below.
            first, end = (1, count) if a == 0 else (0, count - (b == 2))
            columns = slice(first + a - 1, end + a - 1)
            part = block[first:end]
            for i in range(2):
                for j in range(2):
                    below = 2 * (b - a) + j - i
                    if below >= 0 and (a != b or j >= i):
                        band[below, columns, i] += part[:, j, i]
    found = solveh_banded(band.reshape(6, -1), -right[1:-1].ravel(), lower=True)
    return np.asarray(found.reshape(count, 2))


def moved(shift: Array, square: Array, dt: float) -> Array:
    """Return how the CoM has to move (n, 2) for its CoP to be shifted so (n, 2) [m], exactly.

    Other than :func:`least_moved`, whose squares of h/(g + z'')/dt^2 leave too few digits for
    motions of a thousand frames a second.

    Parameters
    ----------
    shift:
        NaN where nothing is wanted, where it is interpolated.
    square:
        h/(g + z'') (n,) [s^2].
    """
    count, frames = len(shift), np.arange(len(shift))
    ways, bands = _ways(square, dt), np.zeros((3, count))
    bands[0, 1:], bands[1], bands[2, :-1] = ways[:-1, 2], ways[:, 1], ways[1:, 0]
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
