"""Triangles of the simple shapes that robot descriptions are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.validate import Array

AROUND = 96  # vertices around an axis: a chord is at most 0.05 % of the radius inside the circle
ALONG = 48  # from pole to pole


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles: ``vertices`` (k, 3) [m] and ``faces`` (m, 3), indices of vertices."""

    vertices: Array
    faces: NDArray[np.int64]


def box(half: Array) -> Surface:
    """Return a box centred at the origin, with half side lengths (3,)."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return Surface(corners * half, np.array(faces, dtype=np.int64))


def cylinder(radius: float, half_length: float) -> Surface:
    """Return a closed cylinder around z."""
    ends = np.array([-half_length, -half_length, half_length, half_length])
    return _revolved(np.array([0.0, radius, radius, 0.0]), ends)


def cone(radius: float, half_length: float) -> Surface:
    """Return a closed cone around z, its apex at the upper end."""
    ends = np.array([-half_length, -half_length, half_length])
    return _revolved(np.array([0.0, radius, 0.0]), ends)


def rounded_cylinder(radius: float, half_length: float) -> Surface:
    """Return a capsule around z: a cylinder with a half ball on either end."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ALONG + 2)  # none of them 0
    heights = radius * np.sin(angles) + np.copysign(half_length, angles)
    return _revolved(radius * np.cos(angles), heights)


def ellipsoid(radii: Array) -> Surface:
    """Return an ellipsoid centred at the origin, with semi-axes (3,) along x, y, z."""
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ALONG + 1)
    ball = _revolved(np.cos(angles), np.sin(angles))
    return Surface(ball.vertices * radii, ball.faces)


def _revolved(radii: Array, heights: Array) -> Surface:
    """Return the surface that points (radius, height), from the bottom up, sweep around z."""
    angles = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    x, y = np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))  # (rings, AROUND)
    z = np.broadcast_to(heights[:, None], x.shape)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    first = np.arange((len(radii) - 1) * AROUND).reshape(-1, AROUND)
    last = np.roll(first, -1, axis=1)
    lower = np.stack([first, last, last + AROUND], axis=-1)
    upper = np.stack([first, last + AROUND, first + AROUND], axis=-1)
    return Surface(vertices, np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)]))
