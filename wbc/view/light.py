"""Light on triangles, where it comes from, and a blur for shadows."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter

from wbc.validate import Array
from wbc.view.camera import Camera

KEY_POWER, FILL_POWER, SKY_POWER, BASE_POWER = 0.80, 0.20, 0.24, 0.16
GLOSS, SHARPNESS = 0.10, 24.0
GAMMA = 2.2  # of a screen
# As seen from the camera: right, up, towards it. The key light casts the shadow.
KEY, FILL = np.array([-0.45, 0.80, 0.55]), np.array([0.80, 0.10, 0.45])


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
