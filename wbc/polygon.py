"""Convex polygons in the plane: hull, half-planes, distance from the edge, centre of area.

Corners are (k, 2) [m], counter-clockwise. Andrew's monotone chain rather than Qhull: points and
segments are their own hulls here, and a plain controller need not load SciPy.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.validate import Array, finite_array, finite_number, real_array

STRAIGHT = 2e-3  # m: corners that stick out less are dropped
# How far a corner may lie inside the hull of the others, as a fraction of the polygon's size^2.
CONVEX = 1e-9
# Least width of a polygon, as a fraction of its longest edge: narrower ones have no inside.
FLAT = 1e-9


def convex_hull(points: ArrayLike, flat: float = 0.0) -> Array:
    """Return the corners (k, 2) of the convex hull of points (n, 2), counter-clockwise.

    Andrew's monotone chain; collinear and repeated points are dropped. ``flat``: so are corners
    that turn left by less, as a fraction of the points' extent squared; 0 keeps what rounding made.
    """
    rows = sorted({(x, y) for x, y in np.asarray(points, dtype=float).tolist()})
    if len(rows) < 3:
        return np.array(rows).reshape(-1, 2)  # a point or a segment is its own hull
    least = flat * float(np.square(np.ptp(rows, axis=0)).sum()) if flat else 0.0
    lower, upper = _chain(rows, least), _chain(rows[::-1], least)
    return np.array(lower[:-1] + upper[:-1])


def thinned(polygon: Array, tolerance: float = STRAIGHT) -> Array:
    """Return a convex polygon (k, 2) without its flattest corners.

    A corner goes if it sticks out less than ``tolerance`` [m] from the edge that replaces it. What
    is left lies inside the polygon given, so a contact claimed on it is one the foot can give.
    """
    corners = [(float(x), float(y)) for x, y in polygon]
    while len(corners) > 4:  # a quadrilateral is as simple as a sole needs to be
        heights = [
            _turn(a, b, c) / max(np.hypot(c[0] - a[0], c[1] - a[1]), 1e-12)
            for a, b, c in zip(
                corners[-1:] + corners[:-1], corners, corners[1:] + corners[:1], strict=True
            )
        ]
        flattest = int(np.argmin(heights))
        if heights[flattest] > tolerance:
            break
        del corners[flattest]
    return np.array(corners)


def polygon_area(polygon: Array) -> float:
    """Return the area [m^2] of a polygon (k, 2), counter-clockwise; 0 of a segment or point."""
    x, y = polygon.T
    return 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def centroid(polygon: Array) -> Array:
    """Return the centre of area (2,) of a polygon (k, 2), or of a segment or point."""
    x, y = polygon.T
    x1, y1 = np.roll(polygon, -1, axis=0).T
    cross = x * y1 - x1 * y
    area = cross.sum() / 2
    if abs(area) < 1e-9:  # m^2: a thousandth of a square millimetre
        return np.asarray(polygon.mean(axis=0))
    return np.array([(x + x1) @ cross, (y + y1) @ cross]) / (6 * area)


def checked_polygon(polygon: ArrayLike) -> Array:
    """Return the corners (k, 2) as a fresh array; for the errors see :func:`polygon_margin`."""
    given = real_array("polygon", polygon)
    if not given.size:
        raise InvalidInputError("polygon: needs corners [[x, y], ...]")
    corners = finite_array("polygon", given, (len(np.atleast_1d(given)), 2))
    edges = np.roll(corners, -1, axis=0) - corners
    arms = corners - corners[:, None]  # (edge, corner, 2)
    left = edges[:, :1] * arms[..., 1] - edges[:, 1:] * arms[..., 0]
    if left.min() < -CONVEX * float(np.square(edges).sum()):
        raise InvalidInputError("polygon: corners must be those of a convex polygon, anticlockwise")
    return corners


def half_planes(polygon: ArrayLike) -> tuple[Array, Array]:
    """Return outward unit normals (k, 2) and offsets (k,) [m]: inside is normals @ p <= offsets.

    Raises InvalidInputError: no polygon with an inside: fewer than three corners, or not convex and
    anticlockwise.
    """
    return _half_planes(checked_polygon(polygon))


def _half_planes(corners: Array) -> tuple[Array, Array]:
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    corners, edges, lengths = (part[lengths > 0.0] for part in (corners, edges, lengths))
    if len(corners) < 3:
        raise InvalidInputError("polygon: needs three corners at least that are not on one spot")
    normals = np.column_stack((edges[:, 1], -edges[:, 0])) / lengths[:, None]
    # The polygon's reach across each edge; corners on one line have none.
    if float(np.ptp(corners @ normals.T, axis=0).min()) < FLAT * float(lengths.max()):
        raise InvalidInputError("polygon: its corners are on one line, so it has no inside")
    return normals, np.einsum("ij,ij->i", normals, corners)


def inset(polygon: ArrayLike, margin: float) -> Array:
    """Return the corners (k, 2) of what lies ``margin`` [m] or more inside, counter-clockwise.

    Raises InvalidInputError: nothing does; or see :func:`half_planes`.
    """
    checked, margin = checked_polygon(polygon), finite_number("margin", margin)
    normals, offsets = _half_planes(checked)
    corners = checked.tolist()  # a handful, for which plain numbers are ten times as fast
    for (x, y), offset in zip(normals.tolist(), offsets.tolist(), strict=True):
        out = [a * x + b * y - (offset - margin) for a, b in corners]
        kept = []
        ends = zip(corners, corners[1:] + corners[:1], out, out[1:] + out[:1], strict=True)
        for (a, b), (next_a, next_b), out_a, out_b in ends:
            if out_a <= 0.0:
                kept.append((a, b))
            if out_a * out_b < 0.0:
                part = out_a / (out_a - out_b)
                kept.append((a + part * (next_a - a), b + part * (next_b - b)))
        if len(kept) < 3:
            raise InvalidInputError(f"polygon: nothing of it is {margin:g} m inside its edges")
        corners = kept
    return convex_hull(np.round(corners, 12))  # without corners on one spot


def polygon_margin(polygon: ArrayLike, points: ArrayLike) -> Array:
    """Return how far inside a convex polygon points lie (...,) [m]; negative outside.

    The distance to the nearest point of the polygon's edge, in both cases.

    ``polygon``: corners (k, 2) [m] of a convex polygon, counter-clockwise. One or two corners are a
    point or segment, which has no inside: the margin is then at most zero.
    ``points``: points (..., 2) [m].

    Raises InvalidInputError: no corners, not finite, or not convex and counter-clockwise.
    """
    corners = checked_polygon(polygon)
    given = real_array("points", points)
    tested = finite_array("points", given, (*given.shape[:-1], 2))
    edges = np.roll(corners, -1, axis=0) - corners  # (k, 2)
    arms = tested[..., None, :] - corners  # (..., k, 2)
    squares = (edges * edges).sum(axis=-1)
    along = (arms * edges).sum(axis=-1) / np.where(squares > 0.0, squares, 1.0)
    away = arms - np.clip(along, 0.0, 1.0)[..., None] * edges
    distance = np.sqrt((away * away).sum(axis=-1).min(axis=-1))
    if len(corners) < 3:
        return np.asarray(0.0 - distance)
    left = edges[:, 0] * arms[..., 1] - edges[:, 1] * arms[..., 0]  # (..., k)
    return np.where((left >= 0.0).all(axis=-1), distance, -distance)


def nearest_point(polygon: Array, points: Array) -> Array:
    """Return what of a polygon (k, 2), segment or point is nearest to points (..., 2).

    Or of each of many (..., k, 2), of which those with fewer corners have one several times.
    """
    if points.ndim == 1 and _holds(polygon.tolist(), points.tolist()):
        return points
    edges = np.roll(polygon, -1, axis=-2) - polygon
    arms = points[..., None, :] - polygon  # (..., k, 2)
    squares = np.maximum(np.einsum("...ij,...ij->...i", edges, edges), 1e-300)
    shares = np.clip(np.einsum("...ij,...ij->...i", edges, arms) / squares, 0.0, 1.0)
    away = shares[..., None] * edges - arms
    best = np.square(away).sum(axis=-1).argmin(axis=-1)[..., None, None]
    nearest = points + np.take_along_axis(away, best, axis=-2)[..., 0, :]
    if polygon.shape[-2] < 3:
        return np.asarray(nearest)
    left = edges[..., 0] * arms[..., 1] >= edges[..., 1] * arms[..., 0]
    return np.where(left.all(axis=-1, keepdims=True), points, nearest)


def _holds(corners: list[list[float]], point: list[float]) -> bool:
    """Return whether a point is on the left of every edge: most are, and NumPy takes far longer."""
    ends = zip(corners, corners[1:] + corners[:1], strict=True)
    return len(corners) > 2 and all(_turn(a, b, point) >= 0.0 for a, b in ends)


def _chain(rows: list[tuple[float, float]], least: float) -> list[tuple[float, float]]:
    chain: list[tuple[float, float]] = []
    for point in rows:
        while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= least:
            chain.pop()
        chain.append(point)
    return chain


def _turn(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> float:
    """Return twice the signed area of a triangle, positive when a, b, c turn left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
