"""A picture of a robot, its ellipsoid and the ground, pixel by pixel.

Matplotlib's own 3-D plots sort whole triangles from back to front, which goes wrong where shapes
cross, as a robot and its ellipsoid always do. Here every pixel sorts for itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from wbc.validate import Array
from wbc.view.camera import NOTHING, Camera, rasterise
from wbc.view.scene import Scene, colours

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
    ground = (
        ground_picture(scene, camera)
        if scene.grounded
        else np.ones((camera.height, camera.width, 3))
    )
    image = ground.repeat(SAMPLES, axis=0).repeat(SAMPLES, axis=1)
    rows, columns = _box(raster.triangle != NOTHING)
    triangle, depth = raster.triangle[rows, columns], raster.depth[rows, columns]
    robot = triangle != NOTHING
    relief = _relief(depth, scene.size, fine.magnification(scene.centre))
    image[rows, columns][robot] = _lit(scene.corners, scene.colours, fine)[triangle[robot]]
    image[rows, columns][robot] *= relief[robot, None]
    lay_solids(image, raster.depth, scene, fine)
    if scene.glass:
        lay_ellipsoid(image, raster.depth, scene, fine)
    shape = (camera.height, SAMPLES, camera.width, SAMPLES)
    colours = image.reshape(*shape, 3).mean(axis=(1, 3))
    return Picture(np.clip(colours, 0.0, 1.0), raster.depth.reshape(shape).min(axis=(1, 3)))


def _lit(corners: Array, colours: Array, camera: Camera) -> Array:
    """Return the lit colour (m, 3) of each triangle (m, 3, 3); both of its sides are alike."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    to_eye = unit(camera.eye - corners.mean(axis=1))
    normal = unit(normal) * np.copysign(1.0, (normal * to_eye).sum(axis=1))[:, None]
    key, fill = towards(KEY, camera), towards(FILL, camera)
    light = BASE_POWER + SKY_POWER * (0.5 + 0.5 * normal[:, 2])
    light += KEY_POWER * np.maximum(normal @ key, 0.0) + FILL_POWER * np.maximum(normal @ fill, 0.0)
    halfway = unit(to_eye + key)
    gloss = GLOSS * np.maximum((normal * halfway).sum(axis=1), 0.0) ** SHARPNESS
    return colours * light[:, None] ** (1.0 / GAMMA) + gloss[:, None]


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


# ---------------------------------------------------------------------- ground

WHITE = np.ones(3)
COLOUR, GRID_POWER, SHADOW_POWER = np.array([0.955, 0.96, 0.965]), 0.07, 0.22
GRID_STEPS = np.array([0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0])  # m
# Parts of the robot's size: the least grid step, where the ground has nearly faded, a blur.
LEAST_STEP, REACH, SOFTNESS = 0.12, 0.62, 0.012
VIGNETTE = 0.12  # part of the picture


def ground_picture(scene: Scene, camera: Camera) -> Array:
    """Return the picture (height, width, 3) without the robot: a grid that fades, and a shadow."""
    right, down, forward = camera.axes
    x, y = camera.slopes()
    drop = y * down[2] + forward[2]  # of a ray; right is level, so a row has one depth
    below = drop < 0.0
    depth = np.where(below, (scene.ground - camera.eye[2]) / np.where(below, drop, -1.0), 0.0)
    ahead = camera.eye + depth[:, None] * (y[:, None] * down + forward)  # (height, 3)
    place = ahead[:, None, :2] + (depth[:, None] * x)[..., None] * right[:2]
    radius = np.linalg.norm(place - scene.centre[:2], axis=-1) / scene.size
    presence = np.exp(-(np.minimum(radius / REACH, 9.0) ** 5)) * below[:, None] * _vignette(camera)
    step = GRID_STEPS[np.searchsorted(GRID_STEPS[:-1], LEAST_STEP * scene.size)]
    light = 1.0 - GRID_POWER * _grid(place, step) - SHADOW_POWER * _shadow(scene, camera)
    return WHITE + presence[..., None] * (light[..., None] * COLOUR - WHITE)


def _vignette(camera: Camera) -> Array:
    """Return a factor (height, width) that falls to 0 at the left, right and lower edges."""
    columns, rows = np.arange(camera.width), np.arange(camera.height)
    side = np.minimum(columns, columns[::-1]) / (VIGNETTE * camera.width)
    bottom = rows[::-1] / (VIGNETTE * camera.height)
    rise = np.minimum(np.minimum(bottom[:, None], side), 1.0)
    return rise**2 * (3.0 - 2.0 * rise)


def _grid(place: Array, step: float) -> Array:
    """Return how much of each pixel is on a grid line (height, width), 0 to 1."""
    cells = place / step
    off = np.abs(cells - np.round(cells))
    pixel = np.maximum(np.abs(np.gradient(cells, axis=0)), np.abs(np.gradient(cells, axis=1)))
    return np.clip(1.5 - off / np.maximum(pixel, 1e-9), 0.0, 1.0).max(axis=-1)


def _shadow(scene: Scene, camera: Camera) -> Array:
    """Return how much of the key light the robot keeps from the ground (height, width)."""
    sun = unit(towards(KEY, camera) + np.array([0.0, 0.0, 1.5]))  # higher: a short shadow
    corners = scene.corners
    fallen = corners - (corners[..., 2:] - scene.ground) * sun / sun[2]
    coarse = camera.enlarged(0.5)  # it is blurred anyway
    mask = (rasterise(coarse, fallen).triangle != NOTHING).astype(np.float64)
    soft = blurred(mask, max(1, round(SOFTNESS * scene.size * coarse.magnification(scene.centre))))
    rows = np.minimum(np.arange(camera.height) // 2, coarse.height - 1)
    columns = np.minimum(np.arange(camera.width) // 2, coarse.width - 1)
    return blurred(soft[np.ix_(rows, columns)], 2)


# ---------------------------------------------------------------------- obstacles

COVER = 0.3  # how much an obstacle covers what is behind it


def lay_solids(image: Array, depth: Array, scene: Scene, camera: Camera) -> None:
    """Lay the obstacles over what is behind them; changes ``image``.

    ``image`` (height, width, 3) shows the robot, whose depth (height, width) is infinite elsewhere.
    """
    corners = scene.solid_corners
    raster = rasterise(camera, corners)
    seen = raster.depth < depth
    lit = np.clip(_lit(corners, colours(scene.solids), camera), 0.0, 1.0)[raster.triangle[seen]]
    image[seen] += COVER * (lit - image[seen])


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


# ---------------------------------------------------------------------- light and blur

# As seen from the camera: right, up, towards it. The key light casts the shadow.
KEY, FILL = np.array([-0.45, 0.80, 0.55]), np.array([0.80, 0.10, 0.45])


def towards(light: Array, camera: Camera) -> Array:
    """Return the unit vector (3,) in the world that points to a light."""
    right, down, forward = camera.axes
    return unit(light[0] * right - light[1] * down - light[2] * forward)


def unit(vectors: Array) -> Array:
    """Return vectors (..., 3) scaled to length 1; zero stays zero."""
    norm = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(norm > 0.0, norm, 1.0)


def blurred(image: Array, radius: int) -> Array:
    """Return the mean over a square, twice: nearly a Gaussian."""
    for _ in range(2):
        image = uniform_filter(image, 2 * radius + 1, mode="nearest")
    return image
