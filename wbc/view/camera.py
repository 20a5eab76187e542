"""A pinhole camera: where points of the world are in the picture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wbc.validate import Array

MARGIN = 0.03  # of the picture, on every side
FIELD_OF_VIEW = np.deg2rad(14.0)  # of the shorter side: a long lens keeps proportions


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera in the world.

    Attributes
    ----------
    eye:
        Position (3,) [m].
    axes:
        Rows (3, 3): right, down and forward in the world. Right is level.
    focal:
        Focal length in pixels.
    width, height:
        Size of the picture in pixels.
    """

    eye: Array
    axes: Array
    focal: float
    width: int
    height: int

    @classmethod
    def framing(
        cls, points: Array, azimuth: float, elevation: float, width: int, height: int
    ) -> Camera:
        """Return the nearest camera that looks from a direction and has all points in the picture.

        Parameters
        ----------
        points:
            (k, 3) [m].
        azimuth, elevation:
            Where the camera stands as seen from the points [rad]; azimuth 0 is in front (x), pi/2
            to the left (y).
        width, height:
            Size of the picture in pixels.
        """
        axes = viewing_axes(azimuth, elevation)
        focal = 0.5 * min(width, height) / np.tan(0.5 * FIELD_OF_VIEW)
        seen = points @ axes.T
        # From a distance d behind the origin, a point (x, y, z) is within half a picture of the
        # middle cx if |x - cx| <= t (z + d). Both sides bound cx, and leave room for it from some
        # d on.
        slopes = (0.5 - MARGIN) * np.array([width, height]) / focal
        low = (seen[:, :2] + slopes * seen[:, 2:]).min(axis=0)
        high = (seen[:, :2] - slopes * seen[:, 2:]).max(axis=0)
        distance = float(((high - low) / (2.0 * slopes)).max())
        middle = 0.5 * (low + high)
        return cls(np.array([*middle, -distance]) @ axes, axes, focal, width, height)

    def moved(self, offset: Array) -> Camera:
        """Return the same camera at another place, ``offset`` (3,) [m] away."""
        return replace(self, eye=self.eye + offset)

    def enlarged(self, factor: float) -> Camera:
        """Return the camera of the same picture with ``factor`` times the pixels on a side."""
        width, height = round(self.width * factor), round(self.height * factor)
        return replace(self, focal=self.focal * factor, width=width, height=height)

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return pixel coordinates (k, 2), from the upper left corner, and depths (k,) [m]."""
        seen = (points - self.eye) @ self.axes.T
        depth = seen[:, 2]
        middle = 0.5 * np.array([self.width, self.height])
        return middle + self.focal * seen[:, :2] / depth[:, None], depth

    def magnification(self, point: Array) -> float:
        """Return how many pixels a metre at a point (3,) covers, if it is about in the middle."""
        return self.focal / float(np.linalg.norm(point - self.eye))

    def slopes(self) -> tuple[Array, Array]:
        """Return x (width,) and y (height,) of the pixels' middles in a picture of unit depth.

        The direction through a pixel's middle is ``x * right + y * down + forward``.
        """
        x = (np.arange(self.width) + 0.5 - 0.5 * self.width) / self.focal
        y = (np.arange(self.height) + 0.5 - 0.5 * self.height) / self.focal
        return x, y


def viewing_axes(azimuth: float, elevation: float) -> Array:
    """Return right, down and forward (rows of (3, 3)) of a camera that looks from a direction."""
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    forward = -np.array([*(np.cos(elevation) * level[:2]), np.sin(elevation)])
    right = np.array([-level[1], level[0], 0.0])
    return np.stack([right, np.cross(forward, right), forward])
