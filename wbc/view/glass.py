"""The ellipsoid as a body of tinted glass."""

from __future__ import annotations

import numpy as np

from wbc.validate import Array
from wbc.view.camera import Camera
from wbc.view.light import KEY, towards, unit
from wbc.view.scene import Scene

FACE_ON, EDGE_ON = 0.12, 0.70  # how much a surface covers what is behind it
FAR, NEAR = 0.6, 1.0  # and how strong each of the two surfaces is
SHINE = 0.30
THINNEST = 1e-4  # m: a flat ellipsoid is drawn this thick


def lay_ellipsoid(image: Array, depth: Array, scene: Scene, camera: Camera) -> None:
    """Lay the ellipsoid's two surfaces over what is behind each of them; changes ``image``.

    ``image`` (height, width, 3) shows the robot, whose depth (height, width) is infinite elsewhere.

    In coordinates in which the ellipsoid is the unit ball, a ray is e + t d and meets it where
    t^2 d.d + 2 t d.e + e.e - 1 = 0; t is the depth, since rays have unit depth.
    """
    axes, semi_axes = scene.ellipsoid.axes, np.maximum(scene.ellipsoid.semi_axes, THINNEST)
    eye = (camera.eye - scene.centre) @ axes / semi_axes
    right, down, forward = camera.axes @ axes / semi_axes
    x, y = camera.slopes()
    y = y[:, None]
    square = (right @ right) * x**2 + (down @ down) * y**2 + forward @ forward
    square += 2.0 * ((right @ down) * y * x + (right @ forward) * x + (down @ forward) * y)
    mixed = (right @ eye) * x + (down @ eye) * y + forward @ eye
    discriminant = mixed**2 - square * (eye @ eye - 1.0)
    row, column = np.nonzero(discriminant > 0.0)
    root = np.sqrt(discriminant[row, column])
    square, mixed, depth = square[row, column], mixed[row, column], depth[row, column]
    slopes = np.column_stack([x[column], y[row, 0], np.ones(len(row))])
    ways, rays = slopes @ np.stack([right, down, forward]), unit(slopes @ camera.axes)
    under = image[row, column]
    for sign, strength in ((1.0, FAR), (-1.0, NEAR)):
        reach = (sign * root - mixed) / square
        normal = unit((eye + reach[:, None] * ways) / semi_axes @ axes.T)
        veiled = _glazed(under, normal, rays, scene.tint, camera, strength)
        under = np.where((reach < depth)[:, None], veiled, under)
    image[row, column] = under


def _glazed(
    under: Array, normal: Array, rays: Array, tint: Array, camera: Camera, strength: float
) -> Array:
    """Return colours (k, 3) seen through glass: clear where it is seen face on, not at the edge."""
    facing = np.abs((normal * rays).sum(axis=-1))
    slant = 1.0 - facing
    cover = strength * (FACE_ON + (EDGE_ON - FACE_ON) * slant * slant * slant)
    glass = tint * (0.80 + 0.20 * normal[:, 2:])
    shine = _power64(np.maximum(normal @ unit(towards(KEY, camera) - camera.axes[2]), 0.0))
    return under + cover[:, None] * (glass - under) + SHINE * shine[:, None]


def _power64(base: Array) -> Array:
    for _ in range(6):  # six squarings are far cheaper than a call of the general power
        base = base * base
    return base
