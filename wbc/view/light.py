"""Where the light comes from."""

from __future__ import annotations

import numpy as np

from wbc.validate import Array
from wbc.view.camera import Camera

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
