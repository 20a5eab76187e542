"""The ground: a grid that fades with the distance, and the robot's shadow on it."""

from __future__ import annotations

import numpy as np

from wbc.validate import Array
from wbc.view.blur import blurred
from wbc.view.camera import Camera
from wbc.view.light import KEY, towards, unit
from wbc.view.raster import NOTHING, rasterise
from wbc.view.scene import Scene

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
