"""The ground in a picture: a fading grid, boards, and the robot's shadow; light on triangles."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates, uniform_filter

from wbc.validate import Array
from wbc.view.camera import NOTHING, Camera, rasterise
from wbc.view.scene import Scene, colours, triangles

KEY_POWER, FILL_POWER, SKY_POWER, BASE_POWER = 0.80, 0.20, 0.24, 0.16
GLOSS, SHARPNESS = 0.10, 24.0
GAMMA = 2.2  # of a screen
# As seen from the camera: right, up, towards it. The key light casts the shadow.
KEY, FILL = np.array([-0.45, 0.80, 0.55]), np.array([0.80, 0.10, 0.45])
WHITE = np.ones(3)
COLOUR, GRID_POWER, SHADOW_POWER = np.array([0.955, 0.96, 0.965]), 0.07, 0.22
GRID_STEPS = np.array([0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0])  # m
LEAST_STEP, SOFTNESS = 0.12, 0.012  # parts of the robot's size: the least grid step, a blur
REACH = 0.62  # of what is in the picture: where the ground has nearly faded
VIGNETTE = 0.12  # part of the picture


def shaded(corners: Array, colours: Array, camera: Camera) -> Array:
    """Return the lit colour (m, 3) of each triangle (m, 3, 3); both of its sides are alike."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    to_eye = unit(camera.eye - corners.mean(axis=1))
    normal = unit(normal) * np.copysign(1.0, (normal * to_eye).sum(axis=1))[:, None]
    key, fill = light_direction(KEY, camera), light_direction(FILL, camera)
    light = BASE_POWER + SKY_POWER * (0.5 + 0.5 * normal[:, 2])
    light += KEY_POWER * np.maximum(normal @ key, 0.0) + FILL_POWER * np.maximum(normal @ fill, 0.0)
    halfway = unit(to_eye + key)
    gloss = GLOSS * np.maximum((normal * halfway).sum(axis=1), 0.0) ** SHARPNESS
    return colours * light[:, None] ** (1.0 / GAMMA) + gloss[:, None]


def light_direction(light: Array, camera: Camera) -> Array:
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


def ground_picture(scene: Scene, camera: Camera, samples: int) -> tuple[Array, Array]:
    """Return the picture without the robot, and the depth of the boards [m], infinite elsewhere.

    Both are finer than the camera's picture: (height * samples, width * samples), the first with
    three colours. They are white and infinite where there is no ground.
    """
    fine = camera.enlarged(samples)
    if not scene.grounded:
        return np.ones((fine.height, fine.width, 3)), np.full((fine.height, fine.width), np.inf)
    shadow = _shadow(scene, camera)
    image = _plane_picture(scene, camera, shadow).repeat(samples, axis=0).repeat(samples, axis=1)
    return image, _lay_boards(image, scene, fine, camera, shadow)


def _plane_picture(scene: Scene, camera: Camera, shadow: Array) -> Array:
    """Return the picture (height, width, 3) of the plane, with a shadow (height, width) on it."""
    right, down, forward = camera.axes
    x, y = camera.slopes()
    depth = _plane_depth(scene, camera)
    ahead = camera.eye + depth[..., None] * (y[:, None] * down + forward)[:, None]
    place = ahead[..., :2] + (depth * x)[..., None] * right[:2]
    presence = _opacity(scene, place) * (depth != 0.0) * _vignette(camera)
    step = GRID_STEPS[np.searchsorted(GRID_STEPS[:-1], LEAST_STEP * scene.size)]
    light = 1.0 - GRID_POWER * _grid(place, step) - SHADOW_POWER * shadow
    return WHITE + presence[..., None] * (light[..., None] * COLOUR - WHITE)


def _plane_depth(scene: Scene, camera: Camera) -> Array:
    """Return the depth (height, width) at which pixels see the plane [m]; 0 where they do not."""
    right, down, forward = camera.axes @ scene.terrain.upright
    x, y = camera.slopes()
    drop = (y * down + forward)[:, None] + x * right  # of a ray, towards the plane
    below = drop < 0.0
    return np.where(below, -scene.above_plane(camera.eye) / np.where(below, drop, -1.0), 0.0)


def _opacity(scene: Scene, place: Array) -> Array:
    """Return how much there is of the ground at places (..., 2): it fades around the robot."""
    radius = np.linalg.norm(place - scene.centre[:2], axis=-1) / scene.spread
    return np.exp(-(np.minimum(radius / REACH, 9.0) ** 5))


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


# ---------------------------------------------------------------------- shadow


def _shadow(scene: Scene, camera: Camera) -> Array:
    """Return how much of the key light the robot keeps from the plane (height, width)."""
    coarse = camera.enlarged(0.5)  # it is blurred anyway
    mask = rasterise(coarse, _shadow_points(scene, camera, scene.corners)).triangle != NOTHING
    radius = max(1, round(SOFTNESS * scene.size * coarse.magnification(scene.centre)))
    soft = blurred(mask.astype(np.float64), radius)
    rows = np.minimum(np.arange(camera.height) // 2, coarse.height - 1)
    columns = np.minimum(np.arange(camera.width) // 2, coarse.width - 1)
    return blurred(soft[np.ix_(rows, columns)], 2)


def _shadow_points(scene: Scene, camera: Camera, points: Array) -> Array:
    """Return where on the plane the shadows of points (..., 3) are."""
    sun = unit(light_direction(KEY, camera) + np.array([0.0, 0.0, 1.5]))  # higher: a short shadow
    above = scene.above_plane(points)[..., None]
    return points - above * sun / (sun @ scene.terrain.upright)


# ---------------------------------------------------------------------- boards


def _lay_boards(image: Array, scene: Scene, camera: Camera, coarse: Camera, shadow: Array) -> Array:
    """Lay the boards over the plane, and return their depth [m]; changes ``image``.

    ``shadow`` is the plane's, as ``coarse`` sees it: light that does not come to a point of a board
    would not come to the point of the plane behind it.
    """
    corners = triangles(scene.boards)
    raster, plane = rasterise(camera, corners), _plane_depth(scene, camera)
    seen = raster.depth < np.where(plane > 0.0, plane, np.inf)
    row, column = np.nonzero(seen)
    x, y = camera.slopes()
    rays = np.column_stack((x[column], y[row], np.ones(len(row)))) @ camera.axes
    points = camera.eye + raster.depth[seen][:, None] * rays
    behind, _ = coarse.project(_shadow_points(scene, camera, points))
    shade = map_coordinates(shadow, behind[:, ::-1].T - 0.5, order=1)
    light = shaded(corners, colours(scene.boards), camera)[raster.triangle[seen]]
    light *= 1.0 - SHADOW_POWER * shade[:, None]
    presence = _opacity(scene, points[:, :2]) * _vignette(camera)[seen]
    image[seen] = WHITE + presence[:, None] * (np.minimum(light, 1.0) - WHITE)
    return np.where(seen, raster.depth, np.inf)
