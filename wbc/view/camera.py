"""A pinhole camera: where points are in the picture, and which triangle is seen in each pixel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wbc.validate import Array

MARGIN = 0.03  # of the picture, on every side
FIELD_OF_VIEW = np.deg2rad(14.0)  # of the shorter side: a long lens keeps proportions
NOTHING = -1
CHUNK = 50_000  # candidate pixels treated at once: their arrays stay in the processor's cache

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera in the world."""

    eye: Array  # position (3,) [m]
    axes: Array  # Rows (3, 3): right, down and forward in the world. Right is level.
    focal: float  # focal length in pixels
    # width and height: size of the picture in pixels.
    width: int
    height: int

    @classmethod
    def framing(
        cls, points: Array, azimuth: float, elevation: float, width: int, height: int
    ) -> Camera:
        """Return the nearest camera that looks from a direction and has all points in the picture.

        ``points``: (k, 3) [m].
        ``azimuth``, ``elevation``: where the camera stands as seen from the points [rad]; azimuth 0
        is in front (x), pi/2 to the left (y).
        ``width``, ``height``: size of the picture in pixels.
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
        x = (np.arange(self.width, dtype=float) + 0.5 - 0.5 * self.width) / self.focal
        y = (np.arange(self.height, dtype=float) + 0.5 - 0.5 * self.height) / self.focal
        return x, y


def viewing_axes(azimuth: float, elevation: float) -> Array:
    """Return right, down and forward (rows of (3, 3)) of a camera that looks from a direction."""
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    forward = -np.array([*(np.cos(elevation) * level[:2]), np.sin(elevation)])
    right = np.array([-level[1], level[0], 0.0])
    return np.stack([right, np.cross(forward, right), forward])


# ---------------------------------------------------------------------- what is seen


@dataclass(frozen=True, eq=False)
class Raster:
    """What a camera sees."""

    # Index of the nearest triangle in each pixel (height, width); NOTHING if none.
    triangle: Indices
    depth: Array  # its depth [m]; infinite where there is none


def rasterise(camera: Camera, corners: Array) -> Raster:
    """Return the nearest triangle in each pixel.

    ``corners``: triangles (m, 3, 3) [m]: triangle, corner, coordinate. Those that reach behind the
    camera are left out.
    """
    pixels, depth = camera.project(corners.reshape(-1, 3))
    # The inverse depth of a flat triangle is linear in the picture, so it is interpolated exactly.
    nearness = np.zeros(camera.width * camera.height)
    triangle = np.full(nearness.shape, NOTHING)
    xy, inverse = pixels.reshape(-1, 3, 2), (1.0 / depth).reshape(-1, 3)
    for index, pixel, value in _fragments(camera, xy, inverse):
        np.maximum.at(nearness, pixel, value)
        seen = nearness[pixel] == value
        triangle[pixel[seen]] = index[seen]
    shape = (camera.height, camera.width)
    with np.errstate(divide="ignore"):
        return Raster(triangle.reshape(shape), (1.0 / nearness).reshape(shape))


def _fragments(
    camera: Camera, xy: Array, inverse: Array
) -> Iterator[tuple[Indices, Indices, Array]]:
    """Yield, in chunks, (triangle, pixel, inverse depth) for each pixel middle in a triangle."""
    size = np.array([camera.width, camera.height])
    first = np.clip(np.ceil(xy.min(axis=1) - 0.5), 0, size).astype(np.int64)
    last = np.clip(np.floor(xy.max(axis=1) - 0.5) + 1, 0, size).astype(np.int64)
    spans = np.maximum(last - first, 0)  # (m, 2) columns and rows of the bounding box
    counts = spans.prod(axis=1) * (inverse > 0.0).all(axis=1)  # none of what is behind the camera
    chosen = np.flatnonzero(counts)  # of a fine mesh, most triangles miss every middle
    planes, flat = _planes(xy[chosen], inverse[chosen])
    chosen, planes = chosen[~flat], planes[:, ~flat]
    spans, first, counts = spans[chosen], first[chosen], counts[chosen]
    chunk = np.cumsum(counts) // CHUNK
    for part in np.split(np.arange(len(chosen)), np.flatnonzero(np.diff(chunk)) + 1):
        index = np.repeat(part, counts[part])
        start = np.cumsum(counts[part]) - counts[part]
        place = np.arange(len(index)) - np.repeat(start, counts[part])
        row, column = np.divmod(place, spans[index, 0])
        row += first[index, 1]
        column += first[index, 0]
        inside, value = _inside(planes[:, index], column, row)
        yield chosen[index[inside]], (row * camera.width + column)[inside], value[inside]


def _planes(xy: Array, inverse: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return linear functions of the picture for each triangle, and which triangles have no area.

    Each row triple (a, b, c) of the (9, m) array stands for a x + b y + c: the barycentric
    coordinates of the second and the third corner, and the inverse depth.
    """
    (x0, y0), (x1, y1), (x2, y2) = xy.transpose(1, 2, 0)
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    flat = np.abs(area) < 1e-12
    scale = 1.0 / np.where(flat, 1.0, area)
    first = np.stack([y2 - y0, x0 - x2, x2 * y0 - x0 * y2]) * scale
    second = np.stack([y0 - y1, x1 - x0, x0 * y1 - x1 * y0]) * scale
    base, rise1, rise2 = inverse[:, 0], inverse[:, 1] - inverse[:, 0], inverse[:, 2] - inverse[:, 0]
    depth = rise1 * first + rise2 * second
    depth[2] += base
    return np.concatenate([first, second, depth]), flat


def _inside(planes: Array, column: Indices, row: Indices) -> tuple[NDArray[np.bool_], Array]:
    x, y = column + 0.5, row + 0.5
    first = planes[0] * x + planes[1] * y + planes[2]
    second = planes[3] * x + planes[4] * y + planes[5]
    inside = (first >= 0.0) & (second >= 0.0) & (first + second <= 1.0)
    return inside, planes[6] * x + planes[7] * y + planes[8]
