"""A picture of a robot, its ellipsoid and the ground, pixel by pixel.

Matplotlib's 3-D plots sort whole triangles from back to front, which fails where shapes intersect,
as a robot and its ellipsoid always do. Here depth is resolved per pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.validate import Array
from wbc.view.camera import NOTHING, Camera, rasterise
from wbc.view.ground import KEY, blurred, ground_picture, light_direction, shaded, unit
from wbc.view.scene import Scene, colours

SAMPLES = 2  # per side of a pixel
MARK_DEPTH = 0.03  # m: a mark no farther behind a board's surface lies on it, at a slant
CREVICE_POWER, OUTLINE_POWER = 0.45, 0.55
CREVICE_REACH, CREVICE_DEPTH, OUTLINE_STEP = 0.022, 0.06, 0.02  # parts of the robot's size


@dataclass(frozen=True, eq=False)
class Picture:
    """Colours (height, width, 3) in [0, 1], and the depth (height, width) of what hides marks [m].

    That is the robot, and a board some way behind its surface; infinite elsewhere.
    """

    colours: Array
    depth: Array


def render(scene: Scene, camera: Camera) -> Picture:
    """Return the picture of a scene."""
    fine = camera.enlarged(SAMPLES)
    raster = rasterise(fine, scene.corners)
    image, boards = ground_picture(scene, camera, SAMPLES)
    rows, columns = _box(raster.triangle != NOTHING)
    triangle, depth = raster.triangle[rows, columns], raster.depth[rows, columns]
    robot = (triangle != NOTHING) & (depth < boards[rows, columns])
    relief = _relief(depth, scene.size, fine.magnification(scene.centre))
    image[rows, columns][robot] = shaded(scene.corners, scene.colours, fine)[triangle[robot]]
    image[rows, columns][robot] *= relief[robot, None]
    solid = np.minimum(raster.depth, boards)
    lay_solids(image, solid, scene, fine)
    if scene.glass:
        lay_ellipsoid(image, solid, scene, fine)
    shape = (camera.height, SAMPLES, camera.width, SAMPLES)
    colours = image.reshape(*shape, 3).mean(axis=(1, 3))
    nearest = np.minimum(raster.depth, boards + MARK_DEPTH).reshape(shape).min(axis=(1, 3))
    return Picture(np.clip(colours, 0.0, 1.0), nearest)


def _box(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Return the rows and the columns of a picture that hold all that is true; never none."""
    spans = [np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0)]
    rows, columns = (slice(k[0], k[-1] + 1) if len(k) else slice(0, 1) for k in spans)
    return rows, columns


def _relief(depth: Array, size: float, magnification: float) -> Array:
    """Return a factor (height, width) that darkens crevices and draws the outlines of parts.

    A pixel that lies behind the mean of its surroundings is in a crevice.
    """
    seen = np.isfinite(depth)
    filled = np.where(seen, depth, depth[seen].max(initial=0.0))
    reach = max(1, round(CREVICE_REACH * size * magnification))  # pixels
    behind = filled - blurred(filled, reach)
    factor = 1.0 - CREVICE_POWER * np.clip(behind / (CREVICE_DEPTH * size), 0.0, 1.0)
    padded = np.pad(depth, 1, constant_values=np.inf)
    height, width = depth.shape
    for row, column in ((0, 1), (2, 1), (1, 0), (1, 2)):
        next_depth = padded[row : row + height, column : column + width]
        factor[next_depth - filled > OUTLINE_STEP * size] *= OUTLINE_POWER
    return factor


# ---------------------------------------------------------------------- obstacles

OBSTACLE_OPACITY = 0.3  # how much an obstacle covers what is behind it


def lay_solids(image: Array, depth: Array, scene: Scene, camera: Camera) -> None:
    """Lay the obstacles over what is behind them; changes ``image``.

    ``image`` (height, width, 3) shows the robot, whose depth (height, width) is infinite elsewhere.
    """
    corners = scene.solid_corners
    raster = rasterise(camera, corners)
    seen = raster.depth < depth
    shade = np.clip(shaded(corners, colours(scene.solids), camera), 0.0, 1.0)[raster.triangle[seen]]
    image[seen] += OBSTACLE_OPACITY * (shade - image[seen])


# ---------------------------------------------------------------------- glass

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
        veiled = _through_glass(under, normal, rays, scene.tint, camera, strength)
        under = np.where((reach < depth)[:, None], veiled, under)
    image[row, column] = under


def _through_glass(
    under: Array, normal: Array, rays: Array, tint: Array, camera: Camera, strength: float
) -> Array:
    """Return colours (k, 3) seen through glass: clear where it is seen face on, not at the edge."""
    facing = np.abs((normal * rays).sum(axis=-1))
    slant = 1.0 - facing
    cover = strength * (FACE_ON + (EDGE_ON - FACE_ON) * slant * slant * slant)
    glass = tint * (0.80 + 0.20 * normal[:, 2:])
    shine = _power64(np.maximum(normal @ unit(light_direction(KEY, camera) - camera.axes[2]), 0.0))
    return under + cover[:, None] * (glass - under) + SHINE * shine[:, None]


def _power64(base: Array) -> Array:
    for _ in range(6):  # six squarings are far cheaper than a call of the general power
        base = base * base
    return base
