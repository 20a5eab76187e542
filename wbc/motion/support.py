"""Which feet stand, and how far the CoP is inside what they span, for all frames at once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from wbc.robot import Robot
from wbc.validate import Array

# m: a foot stands if all corners of its sole are this near to the ground.
TOUCHING = 0.01
SAME = 1e-9  # m: corners nearer than this are one
STRAIGHT = 1e-9  # rad: edges that turn by less are one


def sole_corners(robot: Robot, soles: Mapping[str, Array]) -> Array:
    """Return the corners (n, f, k, 3) [m] of all soles; ones with fewer repeat their last."""
    most = max(len(foot.polygon) for foot in robot.feet.values())
    parts = []
    for name, foot in robot.feet.items():
        polygon = foot.polygon[np.minimum(np.arange(most), len(foot.polygon) - 1)]
        flat = np.column_stack((polygon, np.zeros(most), np.ones(most)))  # (k, 4)
        parts.append((flat @ np.swapaxes(soles[name], 1, 2))[..., :3])
    return np.stack(parts, axis=1)


def touching(corners: Array, height: float) -> NDArray[np.bool_]:
    """Return which feet stand (n, f), bool: all corners within 1 cm of the ground."""
    return np.asarray((np.abs(corners[..., 2] - height) <= TOUCHING).all(axis=2))


def support_margins(corners: Array, standing: NDArray[np.bool_], points: Array) -> Array:
    """Return how far points are inside the hull of the standing soles (n,) [m].

    Negative outside, NaN where no foot stands; else as :func:`wbc.rmp.ground.polygon_margin`.

    Parameters
    ----------
    corners:
        Corners of the soles (n, f, k, 3) [m].
    standing:
        Which feet stand (n, f).
    points:
        (n, 2) or more columns [m].
    """
    margins = np.full(len(points), np.nan)
    some = np.flatnonzero(standing.any(axis=1))
    if len(some):
        chosen, stand = corners[some][..., :2], standing[some]
        # Corners of feet that do not stand are moved onto one that counts anyway.
        anchor = chosen[np.arange(len(some)), stand.argmax(axis=1), :1]  # (m, 1, 2)
        flat = np.where(stand[:, :, None, None], chosen, anchor[:, None])
        margins[some] = _margins(_hulls(flat.reshape(len(some), -1, 2)), points[some, :2])
    return margins


def _hulls(points: Array) -> Array:
    """Return the corners (n, k, 2) of the hulls of points (n, k, 2), counter-clockwise.

    Gift wrapping, all frames in step: from each corner to the point that has all others to its
    left. Hulls with fewer corners repeat the first.
    """
    count, most, _ = points.shape
    frames = np.arange(count)
    # The lowest point, of several the leftmost, is a corner.
    lowest = np.lexsort((points[..., 0], points[..., 1]), axis=1)[:, 0]
    first = points[frames, lowest]
    hull = np.repeat(first[:, None], most, axis=1)
    here, closed = first, np.zeros(count, dtype=bool)
    for k in range(1, most):
        ahead = np.zeros((count, 2))
        for j in range(most):
            way = points[:, j] - here
            length = (way * way).sum(axis=1)
            turn = ahead[:, 0] * way[:, 1] - ahead[:, 1] * way[:, 0]
            reach = (ahead * ahead).sum(axis=1)
            # Of points in one line the farthest, or rounding would decide which is a corner.
            level = np.abs(turn) <= STRAIGHT * np.sqrt(reach * length)
            right = np.where(level, length > reach, turn < 0.0)
            better = (length > SAME**2) & ((reach == 0.0) | right)
            ahead = np.where(better[:, None], way, ahead)
        here = here + ahead
        closed |= ((here - first) ** 2).sum(axis=1) <= SAME**2
        if closed.all():
            break
        hull[:, k] = np.where(closed[:, None], first, here)
    return hull


def _margins(hulls: Array, points: Array) -> Array:
    """Return the distances (n,) to the nearest edge, negative outside."""
    edges = np.roll(hulls, -1, axis=1) - hulls  # (n, k, 2)
    arms = points[:, None] - hulls
    squares = (edges * edges).sum(axis=2)
    along = (arms * edges).sum(axis=2) / np.where(squares > 0.0, squares, 1.0)
    away = arms - np.clip(along, 0.0, 1.0)[..., None] * edges
    distance = np.sqrt((away * away).sum(axis=2).min(axis=1))
    left = edges[..., 0] * arms[..., 1] - edges[..., 1] * arms[..., 0]
    area = hulls[..., 0] * np.roll(hulls[..., 1], -1, axis=1)
    area = area - hulls[..., 1] * np.roll(hulls[..., 0], -1, axis=1)
    inside = (left >= 0.0).all(axis=1) & (area.sum(axis=1) > 0.0)
    return np.where(inside, distance, -distance)
