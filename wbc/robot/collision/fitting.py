"""Simple shapes for meshes: the smallest capsule, or a hull of few corners, around all vertices.

Both are conservative, and report by how much they exceed the mesh's own convex hull.
"""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, NamedTuple

import coal
import numpy as np

from wbc.native import doubles, lib
from wbc.robot.collision.shapes import Capsule, Hull, Solid
from wbc.validate import Array

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

DIRECTIONS = 128  # a hull has the farthest vertex in each, and along the axes
FIRST_DIRECTIONS = 8  # with which a close hull begins
ROUNDING = 1e-9  # m, added to every radius: "inside" must survive rounding
COAL_ACCURACY = 1e-6  # m, of Coal's distances
THINNEST = 1e-4  # m: flat points get a box of this thickness
CHUNK = 1024  # points processed together: 2 MB of memory
STEPS, ACCURACY = 600, (1e-5, 1e-12)  # of the search for a capsule; [m], [m^3]
_SAMPLES = 400
_hull_cache = dict[int, tuple[weakref.ref[Array], Array]]()  # hulls' corners, by id of the points
VERSION = 3  # of the fits: change it, and everything is fitted again


class Fit(NamedTuple):
    """A shape that holds all points given."""

    shape: Solid
    # How far the shape sticks out of the points' convex hull, at most [m] (sampled for capsules).
    bulge: float


def fit_capsule(points: Array, pad: float = 0.0) -> Fit:
    """Return a capsule of small volume that holds ``points`` (k, 3) with ``pad`` [m] around them.

    The ends are searched (Nelder and Mead, from the principal axes), the radius is the distance of
    the farthest point: wherever the search ends, no point is outside.
    """
    corners = hull_corners(points)
    few = _farthest(corners, _directions(DIRECTIONS))
    middle, size = few.mean(axis=0), float(np.ptp(few, axis=0).max()) + THINNEST
    axes = np.linalg.svd(few - middle, full_matrices=True)[2]
    starts = []
    for axis in axes:
        along = (few - middle) @ axis
        low, high = float(along.min()), float(along.max())
        inset = 0.3 * (high - low)
        ends = middle + np.outer((low + inset, high - inset), axis)
        starts.append(ends.ravel())
    for ends in starts:  # updated in place by the search
        lib.wbc_fit_capsule(len(few), doubles(few), 0.1 * size, STEPS, *ACCURACY, doubles(ends))
    best = min(starts, key=lambda ends: _volume(ends, few)).reshape(2, 3)
    best = _trimmed(best, corners)
    radius = float(_to_segment(corners, best).max()) + pad + ROUNDING
    capsule = Capsule(best.copy(), radius)
    return Fit(capsule, _bulge(capsule, corners))


def fit_hull(points: Array, pad: float = 0.0) -> Fit:
    """Return a rounded hull of at most 134 corners that holds ``points`` (k, 3) and ``pad`` [m].

    Its corners are the farthest points in many directions; its radius covers the others.
    """
    corners = hull_corners(points)
    if _is_flat(corners):
        corners = _thick_box(corners)
    kept = hull_corners(_farthest(corners, _directions(DIRECTIONS)))
    return _rounded_hull(kept, corners, pad)


def fit_close_hull(points: Array, tolerance: float, corners: Array | None = None) -> Fit:
    """Return a rounded hull of few corners whose radius is about ``tolerance`` [m], or less.

    Starting from the farthest points in a few directions, the points farthest outside a face are
    added. ``corners``: :func:`hull_corners` of the points, if known.
    """
    if corners is None:
        corners = hull_corners(points)
    if _is_flat(corners):
        corners = _thick_box(corners)
    kept = _farthest(corners, _directions(FIRST_DIRECTIONS))
    while not _is_flat(kept):
        hull = _hull_of(kept)
        planes = hull.equations
        outside = corners @ planes[:, :3].T + planes[:, 3]  # (corners, faces)
        beyond = outside.max(axis=0) > tolerance
        if not beyond.any():
            return _rounded_hull(kept[hull.vertices], corners, 0.0)
        farthest = np.unique(outside[:, beyond].argmax(axis=0))
        apart = farthest[np.argsort(-outside[farthest].max(axis=1))][: max(len(kept) // 2, 1)]
        kept = np.concatenate((kept, corners[apart]))
    return _rounded_hull(hull_corners(kept), corners, 0.0)


def _rounded_hull(kept: Array, corners: Array, pad: float) -> Fit:
    if _is_flat(kept):
        kept = _thick_box(corners)
    excess = _farthest_from_hull(corners, _hull_of(kept))
    radius = (excess + ROUNDING if excess > 0.0 else 0.0) + pad
    return Fit(Hull(kept.copy(), radius), radius)


def quick_capsule(points: Array) -> Capsule:
    """Return a capsule along a principal axis that holds ``points`` (k, 3), without a search."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=True)[2]
    along = (points - middle) @ axes.T
    tried = [
        _trimmed(middle + np.outer((low, high), axis), points)
        for axis, low, high in zip(axes, along.min(axis=0), along.max(axis=0), strict=True)
    ]
    ends = min(tried, key=lambda found: _volume(found, points))
    return Capsule(ends.copy(), float(_to_segment(points, ends).max()) + ROUNDING)


def convex(vertices: Array) -> coal.CollisionGeometry:
    """Return coal's polytope with these corners (k, 3), not all in one plane."""
    return _polytope(vertices, _hull_of(vertices))


def _polytope(vertices: Array, hull: ConvexHull) -> coal.CollisionGeometry:
    """Return coal's polytope; the mesh round it, from outside the same, if coal refuses that.

    A corner has 255 neighbours at most there, and Qhull cuts a round face into a fan.
    """
    mesh = coal.BVHModelOBBRSS()  # takes whole arrays, unlike polytopes
    mesh.beginModel(len(hull.simplices), len(vertices))
    mesh.addVertices(np.ascontiguousarray(vertices))
    mesh.addTriangles(hull.simplices.astype(np.int64))
    try:
        mesh.buildConvexRepresentation(False)
    except RuntimeError:
        mesh.endModel()
        return mesh
    return mesh.convex


def _trimmed(ends: Array, points: Array) -> Array:
    """Return the ends (2, 3) moved inwards along the axis as far as the radius allows."""
    axis = ends[1] - ends[0]
    length = float(np.linalg.norm(axis))
    if length < THINNEST:
        return ends
    axis = axis / length
    along = (points - ends[0]) @ axis
    across = np.linalg.norm(points - ends[0] - np.outer(along, axis), axis=1)
    radius = float(_to_segment(points, ends).max())
    room = np.sqrt(np.maximum(radius * radius - across * across, 0.0))
    low = min(max(float((along + room).min()), 0.0), length)
    high = min(max(float((along - room).max()), 0.0), length)
    low, high = (low, high) if low < high else (0.5 * (low + high),) * 2
    return ends[0] + np.outer((low, high), axis)


def _volume(ends: Array, points: Array) -> float:
    """Return the volume of the capsule with these ends (6,) that holds the points."""
    segment = ends.reshape(2, 3)
    r = float(_to_segment(points, segment).max())
    return np.pi * r * r * (float(np.linalg.norm(segment[1] - segment[0])) + 4.0 / 3.0 * r)


def _to_segment(points: Array, ends: Array) -> Array:
    """Return the distance (k,) of points to a segment (2, 3)."""
    begin, along = ends[0], ends[1] - ends[0]
    squared = float(along @ along)
    share = (points - begin) @ along / squared if squared > 0.0 else np.zeros(len(points))
    nearest = begin + np.clip(share, 0.0, 1.0)[:, None] * along
    return np.linalg.norm(points - nearest, axis=1)


def _farthest_from_hull(points: Array, hull: ConvexHull, inner: ConvexHull | None = None) -> float:
    """Return the largest distance of points (k, 3) outside a hull; 0 if all are inside.

    The distance to a face of a hull inside it (itself, or ``inner`` with fewer faces) is an upper
    bound: exact distances are computed only for points that may be the farthest.
    """
    most = _to_some_face(points, inner or hull) + COAL_ACCURACY
    polytope, normals, offsets = None, hull.equations[:, :3], hull.equations[:, 3]
    still, place, speck = coal.Transform3s(), coal.Transform3s(), coal.Sphere(1e-12)
    request, farthest = coal.DistanceRequest(), 0.0
    for k in np.argsort(-most).tolist():
        if most[k] <= farthest:
            break
        outside = float((normals @ points[k] + offsets).max())
        if outside <= 0.0:
            continue
        polytope = polytope or _polytope(hull.points, hull)
        place.setTranslation(points[k])
        apart = coal.distance(polytope, still, speck, place, request, coal.DistanceResult())
        farthest = max(farthest, apart, outside)
    return farthest


def _to_some_face(points: Array, hull: ConvexHull) -> Array:
    """Return the distance (k,) of points to the face that they are farthest outside of.

    Minus infinity for points inside the hull.
    """
    normals, offsets = np.ascontiguousarray(hull.equations[:, :3].T), hull.equations[:, 3]
    found = np.full(len(points), -np.inf)
    for start in range(0, len(points), CHUNK):
        over = points[start : start + CHUNK] @ normals
        over += offsets
        face = over.argmax(axis=1)
        outside = np.flatnonzero(over[np.arange(len(over)), face] > 0.0)
        triangles = hull.points[hull.simplices[face[outside]]]
        found[start + outside] = _to_triangles(points[start + outside], triangles)
    return found


def _to_triangles(points: Array, triangles: Array) -> Array:
    """Return the distance (k,) of points (k, 3) to a triangle (k, 3, 3) each."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    nearest = np.full(len(points), np.inf)
    for begin, end in ((a, b), (b, c), (c, a)):
        along = end - begin
        squared = np.maximum(np.einsum("ki,ki->k", along, along), 1e-300)
        share = np.einsum("ki,ki->k", points - begin, along) / squared
        away = points - begin - np.clip(share, 0.0, 1.0)[:, None] * along
        nearest = np.minimum(nearest, np.linalg.norm(away, axis=1))
    normal = np.cross(b - a, c - a)
    inside = np.ones(len(points), dtype=bool)
    for begin, end in ((a, b), (b, c), (c, a)):
        side = np.cross(normal, end - begin)
        inside &= np.einsum("ki,ki->k", points - begin, side) >= 0.0
    size = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    height = np.abs(np.einsum("ki,ki->k", points - a, normal)) / size
    return np.where(inside, height, nearest)


def _bulge(capsule: Capsule, corners: Array) -> float:
    """Return how far the capsule exceeds the hull of ``corners``, by samples."""
    if _is_flat(corners):
        corners = _thick_box(corners)
    few = _farthest(corners, _directions(DIRECTIONS))
    rays = _directions(_SAMPLES)
    axis = capsule.ends[1] - capsule.ends[0]
    ends = np.where((rays @ axis > 0.0)[:, None], capsule.ends[1], capsule.ends[0])
    share = np.linspace(0.0, 1.0, len(rays))[:, None]
    across = rays - np.outer(rays @ axis, axis) / max(float(axis @ axis), 1e-18)
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]
    barrel = capsule.ends[0] + share * axis + capsule.radius * across
    samples = np.concatenate((ends + capsule.radius * rays, barrel))
    return _farthest_from_hull(samples, _hull_of(corners), None if _is_flat(few) else _hull_of(few))


def _directions(count: int) -> Array:
    """Return ``count`` unit vectors, evenly spread (Fibonacci lattice), and the six axes."""
    k = np.arange(count)
    z = 1.0 - (2.0 * k + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z * z)
    lattice = np.stack((flat * np.cos(turn), flat * np.sin(turn), z), axis=1)
    return np.concatenate((lattice, np.eye(3), -np.eye(3)))


def _farthest(points: Array, directions: Array) -> Array:
    """Return the points that are the farthest in some direction."""
    return points[np.unique(np.argmax(directions @ points.T, axis=1))]


def hull_corners(points: Array) -> Array:
    """Return the corners of the convex hull of points (k, 3); all of them if they are flat.

    Several fits use the same mesh, so hulls are cached while their points exist.
    """
    number = id(points)
    known = _hull_cache.get(number)
    if known is None or known[0]() is not points:
        here = weakref.ref(points, lambda _: _hull_cache.pop(number, None))
        known = _hull_cache[number] = here, _hull_corners(points)
    return known[1]


def _hull_of(points: Array) -> ConvexHull:
    from scipy.spatial import ConvexHull  # slow to import: not needed with cached shapes

    return ConvexHull(points)


def _hull_corners(points: Array) -> Array:
    from scipy.spatial import QhullError

    if _is_flat(points):
        return np.unique(points, axis=0)
    try:
        return np.asarray(points[_hull_of(points).vertices])
    except QhullError:  # almost flat: use all points
        return points


def _is_flat(points: Array) -> bool:
    """Return whether the points lie in one plane, for Qhull."""
    if len(points) < 4:
        return True
    return bool(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[2] < 1e-7)


def _thick_box(points: Array) -> Array:
    """Return the corners (8, 3) of an aligned box around the points, never flat."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=True)[2]
    local = (points - middle) @ axes.T
    centre, half = 0.5 * (local.max(axis=0) + local.min(axis=0)), 0.5 * np.ptp(local, axis=0)
    return (Hull.box(2.0 * np.maximum(half, THINNEST)).vertices + centre) @ axes + middle
