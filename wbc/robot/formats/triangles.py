"""Triangles of meshes, and their conversion to coal's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from wbc.validate import Array, Index

# Corners (8, 3) of the box from -1 to 1.
BOX_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


class Triangles(NamedTuple):
    """Vertices (k, 3) [m] and triangles (m, 3) of their indices."""

    vertices: Array
    faces: Index


class Surfaces(NamedTuple):
    """Shapes of a robot, meshes as triangles.

    Distances between whole meshes need coal's BVH over them, which takes most of the time of
    loading a robot's shapes: see :func:`with_meshes`.
    """

    shapes: pin.GeometryModel  # with a unit box in the place of each mesh
    meshes: Mapping[str, Triangles]  # by the name of their shape, in its frame


def with_meshes(surfaces: Surfaces) -> pin.GeometryModel:
    """Return the shapes, with coal's meshes."""
    for shape in surfaces.shapes.geometryObjects:
        if shape.name in surfaces.meshes:
            shape.geometry = as_bvh(*surfaces.meshes[shape.name])
    return surfaces.shapes


def as_bvh(vertices: Array, faces: Index) -> coal.BVHModelBase:
    """Return vertices (k, 3) [m] and triangles (m, 3) as coal's mesh."""
    bvh = coal.BVHModelOBBRSS()
    bvh.beginModel(len(faces), len(vertices))
    bvh.addVertices(vertices)
    bvh.addTriangles(faces)
    bvh.endModel()
    return bvh


def fan(corners: Index, counts: Index) -> Index:
    """Return the triangles (m, 3) of polygons of ``counts`` corners each, listed one by one."""
    starts = np.repeat(np.cumsum(counts) - counts, np.maximum(counts - 2, 0))
    inner = np.concatenate([np.arange(1, count - 1) for count in counts.tolist()] or [starts])
    places = np.stack((starts, starts + inner, starts + inner + 1), axis=1)
    return corners[places.astype(np.int64)]


def merged(parts: list[Triangles]) -> Triangles:
    """Return sub-meshes as one mesh, without vertices that no triangle uses."""
    parts = [part for part in parts if len(part.faces)]
    if not parts:
        return Triangles(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = np.concatenate([part.faces + k for part, k in zip(parts, offsets, strict=True)])
    if faces.min() < 0 or any(part.faces.max(initial=-1) >= len(part.vertices) for part in parts):
        raise ValueError("a corner without a vertex")
    return without_unused_vertices(np.concatenate([part.vertices for part in parts]), faces)


def without_unused_vertices(vertices: Array, faces: Index) -> Triangles:
    """Return triangles without the vertices (k, 3) that none uses."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    if used.all():
        return Triangles(vertices, faces)
    return Triangles(vertices[used], (np.cumsum(used) - 1)[faces])
