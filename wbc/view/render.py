"""A picture of a robot, its ellipsoid and the ground, pixel by pixel.

Matplotlib's own 3-D plots sort whole triangles from back to front, which goes wrong where shapes
cross, as a robot and its ellipsoid always do. Here every pixel sorts for itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wbc.validate import Array
from wbc.view.blur import blurred
from wbc.view.camera import Camera
from wbc.view.glass import lay_ellipsoid
from wbc.view.ground import ground_picture
from wbc.view.light import FILL, KEY, towards, unit
from wbc.view.raster import NOTHING, rasterise
from wbc.view.scene import Scene

SAMPLES = 2  # per side of a pixel
KEY_POWER, FILL_POWER, SKY_POWER, BASE_POWER = 0.80, 0.20, 0.24, 0.16
GLOSS, SHARPNESS = 0.10, 24.0
GAMMA = 2.2  # of a screen
CREVICE_POWER, OUTLINE_POWER = 0.45, 0.55
CREVICE_REACH, CREVICE_DEPTH, OUTLINE_STEP = 0.022, 0.06, 0.02  # parts of the robot's size


@dataclass(frozen=True, eq=False)
class Picture:
    """Colours (height, width, 3) in [0, 1] and the robot's depth (height, width) [m], or inf."""

    colours: Array
    depth: Array


def render(scene: Scene, camera: Camera) -> Picture:
    """Return the picture of a scene."""
    fine = camera.enlarged(SAMPLES)
    raster = rasterise(fine, scene.corners)
    image = ground_picture(scene, camera).repeat(SAMPLES, axis=0).repeat(SAMPLES, axis=1)
    rows, columns = _box(raster.triangle != NOTHING)
    triangle, depth = raster.triangle[rows, columns], raster.depth[rows, columns]
    robot = triangle != NOTHING
    relief = _relief(depth, scene.size, fine.magnification(scene.centre))
    image[rows, columns][robot] = _shaded(scene, fine)[triangle[robot]] * relief[robot, None]
    lay_ellipsoid(image, raster.depth, scene, fine)
    shape = (camera.height, SAMPLES, camera.width, SAMPLES)
    colours = image.reshape(*shape, 3).mean(axis=(1, 3))
    return Picture(np.clip(colours, 0.0, 1.0), raster.depth.reshape(shape).min(axis=(1, 3)))


def _shaded(scene: Scene, camera: Camera) -> Array:
    """Return the lit colour (m, 3) of each triangle; both of its sides are alike."""
    corners = scene.corners
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    to_eye = unit(camera.eye - corners.mean(axis=1))
    normal = unit(normal) * np.copysign(1.0, (normal * to_eye).sum(axis=1))[:, None]
    key, fill = towards(KEY, camera), towards(FILL, camera)
    light = BASE_POWER + SKY_POWER * (0.5 + 0.5 * normal[:, 2])
    light += KEY_POWER * np.maximum(normal @ key, 0.0) + FILL_POWER * np.maximum(normal @ fill, 0.0)
    halfway = unit(to_eye + key)
    gloss = GLOSS * np.maximum((normal * halfway).sum(axis=1), 0.0) ** SHARPNESS
    return scene.colours * light[:, None] ** (1.0 / GAMMA) + gloss[:, None]


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
