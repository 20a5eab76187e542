"""The CoM's path with a feasible CoP: the scaled human's, displaced as little as needed.

On level ground the CoP p, CoM c and angular momentum k satisfy (with f = m (c'' + g))

    c - p = h/(g + z'') c'' - n x k'/f_z ,

so a displacement e of the CoM displaces the CoP by e - h/(g + z'') e''. The CoP has to be inside
the soles: of all paths whose CoP is, this is the one nearest to the human's, over the whole motion
at once. No step is planned anew, none is dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from wbc.validate import Array, Bools

# The CoP's distance from the edge of the soles: part of the smaller sole's length, and of the
# support's width at most.
EDGE_MARGIN, MAX_EDGE_MARGIN = 0.05, 0.3
# Weights of squares of the CoP's displacements and of its distance outside the soles; the CoM's
# displacements have 1.
COP_WEIGHT, OUTSIDE_WEIGHT = 1e-3, 1e3
# The interior-point method: first multipliers and slacks [m], the part of the mean product of both
# that is aimed at, the part of a step to the boundary that is taken, and the duality gap by the
# cost at its end.
FIRST_MULTIPLIER, FIRST_SLACK, CENTERING, BOUNDARY_FRACTION = 1e-2, 1e-2, 0.2, 0.995
GAP, MAX_ITERATIONS = 1e-7, 60
MIN_GRAVITY = 2.0  # m/s^2, of g + z'': below it, (nearly) in flight, there is no CoP


def load_shares(flags: Bools) -> Array:
    """Return the part of the weight that each foot bears (n, 2), by the contacts alone.

    In double support the load shifts from the foot that stood before to the one that stands
    afterwards, on a minimum-jerk curve; where both stood before or stand afterwards, it begins or
    ends evenly shared. In flight it is halved.
    """
    count, both = len(flags), flags[:, 0] & flags[:, 1]
    left = np.where(flags[:, 0] == flags[:, 1], 0.5, flags[:, 0].astype(float))
    for first, end in runs(both):
        start = left[first - 1] if first > 0 else 0.5
        goal = left[end] if end < count else 0.5
        u = (np.arange(first, end, dtype=float) - first + 1.0) / (end - first + 1.0)
        left[first:end] = start + (goal - start) * minimum_jerk(u)
    return np.column_stack((left, 1.0 - left))


def required_cop(
    com: Array, k_rate: Array, mass: float, gravity: float, dt: float
) -> tuple[Array, Array]:
    """Return the CoP that a motion of the CoM (n, 3) over ground at 0 requires.

    Returns
    -------
    tuple
        The CoP (n, 2) [m], NaN where the ground hardly pushes, and h/(g + z'') (n,) [s^2], the
        squared time constant of the inverted pendulum.
    """
    acceleration = np.gradient(np.gradient(com, dt, axis=0), dt, axis=0)
    up = gravity + acceleration[:, 2]
    pushed = up > MIN_GRAVITY
    up = np.maximum(up, MIN_GRAVITY)
    time_constant_sq = com[:, 2] / up
    moment = np.column_stack((-k_rate[:, 1], k_rate[:, 0])) / (mass * up)[:, None]
    cop = com[:, :2] - time_constant_sq[:, None] * acceleration[:, :2] + moment
    cop[~pushed] = np.nan
    return cop, time_constant_sq


@dataclass(frozen=True, eq=False)
class SupportedFrames:
    """The support of some frames."""

    frames: NDArray[np.intp]  # their indices
    # of each foot that stands: 0 (left) or 1 (right), and the corners that touch (k, 3) [m]
    feet: tuple[tuple[int, Array], ...]

    @cached_property
    def polygon(self) -> Array:
        """Convex hull of the corners (k, 2), anticlockwise."""
        return convex_hull(np.concatenate([corners[:, :2] for _, corners in self.feet]))

    @cached_property
    def inset_polygon(self) -> Array:
        """The same less a margin by the smaller of the soles."""
        hull = self.polygon
        sole = min(float(np.ptp(corners[:, :2], axis=0).max()) for _, corners in self.feet)
        width = float(np.ptp(hull @ _normals(hull).T, axis=0).min()) if len(hull) > 2 else 0.0
        margin = min(EDGE_MARGIN * sole, MAX_EDGE_MARGIN * width)
        if margin < 1e-3 * sole:  # a foot on its edge leaves a line
            return hull
        try:
            return inset(hull, margin)
        except InvalidInputError:  # a thin triangle
            return hull

    @cached_property
    def edges(self) -> Array:
        """Outward normals and offsets (m, 3) of the inset polygon."""
        points = hull = self.inset_polygon
        normals = _normals(hull)
        if len(hull) == 2:  # a foot on its edge
            along = (hull[1] - hull[0]) / np.linalg.norm(hull[1] - hull[0])
            normals, points = np.vstack((normals, along, -along)), np.vstack((hull, hull[[1, 0]]))
        return np.column_stack((normals, (normals * points).sum(axis=1)))


def _normals(hull: Array) -> Array:
    """Return the outward normals (k, 2) of a hull's edges."""
    edges = np.roll(hull, -1, axis=0) - hull
    return np.asarray(edges[:, ::-1] * [1.0, -1.0] / np.linalg.norm(edges, axis=1)[:, None])


def supports(corners: Mapping[str, Array], flags: Bools) -> tuple[SupportedFrames, ...]:
    """Return the supports of all frames but those in flight; equal ones are joined.

    ``corners``: of the soles that touch (n, k, 3), by side [m]; ``flags``: which feet stand (n, 2).
    """
    shapes = [np.round(corners[side].reshape(len(flags), -1), 6) for side in SIDES]
    keys = np.hstack((flags, *(np.where(flags[:, [n]], one, 0.0) for n, one in enumerate(shapes))))
    equal = dict[bytes, list[int]]()
    for k in np.flatnonzero(flags.any(axis=1)).tolist():
        equal.setdefault(keys[k].tobytes(), []).append(k)
    return tuple(
        SupportedFrames(
            np.array(frames),
            tuple((n, corners[s][frames[0]]) for n, s in enumerate(SIDES) if flags[frames[0], n]),
        )
        for frames in equal.values()
    )


def project_onto_supports(
    cop: Array, supports: Sequence[SupportedFrames], *, margin: bool = True
) -> Array:
    """Return the nearest CoP (n, 2) in the supports; NaN in flight and where it is NaN.

    Without ``margin`` up to their edges.
    """
    found = np.full_like(cop, np.nan)
    every = [(one.frames, one.inset_polygon if margin else one.polygon) for one in supports]
    for own in ([s for s in every if (len(s[1]) > 2) == wide] for wide in (True, False)):
        if not own:
            continue
        # All frames at once: hulls with fewer corners repeat their last one.
        most = max(len(hull) for _, hull in own)
        hulls = [np.vstack((hull, *[hull[-1:]] * (most - len(hull)))) for _, hull in own]
        frames = np.concatenate([one for one, _ in own])
        each = np.repeat(np.stack(hulls), [len(one) for one, _ in own], axis=0)
        found[frames] = nearest_point(each, cop[frames])
    return found


def least_com_displacement(
    cop: Array, time_constant_sq: Array, dt: float, supports: Sequence[SupportedFrames],
    guess: Array | None = None,
) -> tuple[Array, Array]:  # fmt: skip
    """Return the least displacement (n, 2) of the CoM that brings its CoP inside the soles [m].

    The least squares of the displacements of the CoM and, weighted less, of the CoP. Distances
    outside the soles weigh much more, so that an infeasible CoP is nearly met. Newton's method with
    the violated edges as active set; where that cycles, a primal-dual interior-point method
    (Nocedal and Wright, Numerical Optimization, 2006, sec. 16.6). The Hessian is banded, x and y of
    five frames.

    Parameters
    ----------
    cop:
        Without displacement (n, 2) [m]; NaN where the ground hardly pushes.
    time_constant_sq:
        h/(g + z'') (n,) [s^2].
    guess:
        Of the CoP with displacement (n, 2) [m]: Newton's method begins with the edges it violates.
        None: ``cop``.

    Returns
    -------
    tuple
        The displacement, and the CoP with it.
    """
    most = max((len(one.edges) for one in supports), default=0)
    edges = np.zeros((len(cop), most, 3))  # of each frame's support, padded with zeros
    for one in supports:
        edges[one.frames, : len(one.edges)] = one.edges
    edges[~np.isfinite(cop).all(axis=1)] = 0.0
    edges[[0, -1]] = 0.0  # the accelerations of the first and last frame are not known
    stencil = _cop_stencil(time_constant_sq, dt)
    normals = edges[..., :2]
    transposed = np.swapaxes(normals, 1, 2)
    guess = cop if guess is None else guess
    base, outside = (
        (normals @ np.nan_to_num(one)[..., None])[..., 0] - edges[..., 2] for one in (cop, guess)
    )

    def minimize(stiffness: Array, pull: Array) -> tuple[Array, Array]:
        """Minimise with squares and linear terms of distances o (n, m) outside; return e and o."""
        H = transposed @ (stiffness[..., None] * normals) + COP_WEIGHT * np.eye(2)
        e = _minimize(stencil, H, (transposed @ (pull + stiffness * base)[..., None])[..., 0])
        return e, base + (normals @ _apply_stencil(stencil, e)[..., None])[..., 0]

    fewest, cycling = base.size, 0
    while cycling < 2:  # times that no fewer edges changed than before
        active = outside > 0.0
        e, outside = minimize(np.where(active, OUTSIDE_WEIGHT, 0.0), np.zeros_like(base))
        changed = int(np.count_nonzero((outside > 0.0) != active))
        if not changed:
            break
        cycling += changed >= fewest
        fewest = min(fewest, changed)
    else:
        e = _interior_point(minimize, stencil, base, np.asarray(normals.any(axis=2)))
    return e, cop + _apply_stencil(stencil, e)


def _interior_point(
    minimize: Callable[[Array, Array], tuple[Array, Array]],
    stencil: Array,
    base: Array,
    edges: Bools,
) -> Array:
    """Return the least displacement (n, 2) of the CoM, see :func:`least_com_displacement`.

    ``minimize``: from squares and linear terms of the distances outside the edges, see there.
    ``base``: distances (n, m) without displacement [m].
    ``edges``: which of these there are (n, m).
    """
    # Distances are at most multiplier / OUTSIDE_WEIGHT; slacks are what is left of that.
    e = np.zeros((len(base), 2))
    multipliers = np.where(edges, FIRST_MULTIPLIER, 0.0)
    slacks = np.where(edges, np.maximum(multipliers / OUTSIDE_WEIGHT - base, FIRST_SLACK), 1.0)
    for _ in range(MAX_ITERATIONS):
        target = CENTERING * float((multipliers * slacks).sum()) / np.count_nonzero(edges)
        pull = np.where(edges, 1.0 / (slacks + multipliers / OUTSIDE_WEIGHT), 0.0)
        stiffness, pull = multipliers * pull, target * pull
        goal, outside = minimize(stiffness, pull + stiffness * slacks)
        goals = pull + stiffness * (slacks + outside)
        multiplier_step = goals - multipliers
        slack_step = np.where(edges, goals / OUTSIDE_WEIGHT - outside - slacks, 0.0)
        share = min(
            1.0, _to_boundary(multipliers, multiplier_step), _to_boundary(slacks, slack_step)
        )
        e, multipliers = e + share * (goal - e), multipliers + share * multiplier_step
        slacks = slacks + share * slack_step
        squares = [np.square(x).sum() for x in (e, _apply_stencil(stencil, e), multipliers)]
        cost = float(np.dot((1.0, COP_WEIGHT, 1.0 / OUTSIDE_WEIGHT), squares))
        if share > 0.5 and float((multipliers * slacks).sum()) < GAP * cost:
            break
    return e


def _to_boundary(x: Array, step: Array) -> float:
    """Return the part of a step that leaves a little of each positive x."""
    shrinks = step < 0.0
    return BOUNDARY_FRACTION * float((-x[shrinks] / step[shrinks]).min(initial=np.inf))


def cop_displacement(e: Array, time_constant_sq: Array, dt: float) -> Array:
    """Return the displacements (n, 2) of the CoP for those of the CoM (n, 2)."""
    return _apply_stencil(_cop_stencil(time_constant_sq, dt), e)


def _cop_stencil(time_constant_sq: Array, dt: float) -> Array:
    """Return the coefficients (n, 3) of e - h/(g + z'') e'' in the frames before, at and after."""
    s = time_constant_sq / dt**2
    s[[0, -1]] = 0.0
    return np.column_stack((-s, 1.0 + 2.0 * s, -s))


def _apply_stencil(stencil: Array, e: Array) -> Array:
    found = stencil[:, 1:2] * e
    found[1:] += stencil[1:, :1] * e[:-1]
    found[:-1] += stencil[:-1, 2:] * e[1:]
    return found


def _minimize(stencil: Array, H: Array, gradient: Array) -> Array:
    """Minimise |e|^2/2 + sum_k p_k' H_k p_k/2 + gradient_k' p_k, with p = stencil e; return e."""
    count = len(stencil)
    band, right = np.zeros((6, count, 2)), np.zeros((count + 2, 2))
    band[0] += 1.0
    for a in range(3):
        right[a : count + a] += stencil[:, a : a + 1] * gradient
        for b in range(a, 3):
            block = (stencil[:, a] * stencil[:, b])[:, None, None] * H
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


def com_displacement(shift: Array, time_constant_sq: Array, dt: float) -> Array:
    """Return the displacement (n, 2) of the CoM that shifts its CoP by (n, 2) [m], exactly.

    Unlike :func:`least_com_displacement`, whose squares of h/(g + z'')/dt^2 lose too many digits at
    a thousand frames a second.

    ``shift``: interpolated where it is NaN; ``time_constant_sq``: h/(g + z'') (n,) [s^2].
    """
    count, frames = len(shift), np.arange(len(shift))
    stencil, bands = _cop_stencil(time_constant_sq, dt), np.zeros((3, count))
    bands[0, 1:], bands[1], bands[2, :-1] = stencil[:-1, 2], stencil[:, 1], stencil[1:, 0]
    ends = np.zeros((count, 2))
    ends[0, 0] = ends[-1, 1] = 1.0
    ends = solve_banded((1, 1), bands, ends)  # solutions of the values at both ends
    found = np.zeros((count, 2))
    for axis in range(2):
        known = np.isfinite(shift[:, axis])
        if not known.any():
            continue
        wanted = np.interp(frames, frames[known], shift[known, axis])
        wanted[[0, -1]] = 0.0
        particular = solve_banded((1, 1), bands, wanted)
        found[:, axis] = particular - ends @ np.linalg.lstsq(ends, particular, rcond=None)[0]
    return found
