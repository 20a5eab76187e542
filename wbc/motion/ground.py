"""The ground's force, CoP, CMP, leg, standing feet and CoP margin, in all frames at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.motion.planted_base import AUTO
from wbc.rmp.ground import (
    centre_of_pressure,
    centroidal_moment_pivot,
    in_contact,
    leg_of,
    normal_moment,
)
from wbc.robot import Robot
from wbc.robot.series import CentroidalSeries
from wbc.validate import Array, Bools, names_of

MAX_SOLE_HEIGHT = 0.01  # m, of corners that touch the ground
# m/s, along the ground: soles that roll over an edge do not slide, those that swing over it do.
MAX_ROLLING_SPEED = 0.25
SAME_CORNER = 1e-9  # m, between corners
FRAMES_PER_BATCH = 500  # whose arrays stay in the processor's cache
COLLINEAR = 1e-9  # rad: a corner at this angle to the right of an edge is on it


def ground_reaction(
    robot: Robot,
    whole: CentroidalSeries,
    height: float,
    measured: tuple[Array, Array] | None = None,
) -> dict[str, Any]:
    """Return the ground's force and the leg by their names in RmpSeries, n frames; NaN in flight.

    ``measured``: force [N] and moment about the CoM [N m] of the ground (n, 3); None: by the
    motion.

    Raises InvalidInputError: the CoM is at the CoP in some frame.
    """
    if measured is None:
        weight = robot.mass * robot.model.gravity.linear
        measured = whole.momentum_rate[:, :3] - weight, whole.momentum_rate[:, 3:]
    force, moment = measured
    on = in_contact(force, robot.weight).astype(bool)
    com, f, k = whole.com[on], force[on], moment[on]
    p = centre_of_pressure(com, f, k, height)
    length, direction, angles = leg_of(com, p)
    found: dict[str, Any] = {"ground_force": force, "flight": ~on}
    for name, values in {
        "ground_moment": normal_moment(com, f, k, p),
        "cop": p,
        "cmp": centroidal_moment_pivot(com, f, height),
        "leg_length": length,
        "leg_direction": direction,
        "leg_angles": angles,
    }.items():
        found[name] = np.full((len(on), *values.shape[1:]), np.nan)
        found[name][on] = values
    return found


@dataclass(frozen=True, eq=False)
class SupportMargin:
    """Distance of n points inside the hull of f feet, and its derivatives."""

    margin: Array  # (n,) [m], negative outside, NaN where no foot stands
    # By the point (n, 2): a unit vector away from the nearest edge if inside, else towards it; 0 on
    # an edge, where it has a kink.
    gradient: Array
    # Weight of each foot (n, f) in the edge's nearest point: derivatives by feet are minus the
    # gradient times it.
    weights: Array


# ---------------------------------------------------------------------- feet


def feet_to_check(robot: Robot, feet: str | Iterable[str] | None) -> tuple[str, ...]:
    """Return the feet to check: those named, all for ``auto``, none for None.

    Raises InvalidInputError: an empty choice, or a foot that is named twice; UnknownNameError: a
    foot that the robot does not have; see :meth:`Robot.foot`.
    """
    if feet is None:
        return ()
    if isinstance(feet, str) and feet == AUTO:
        return tuple(robot.feet)
    names = names_of("feet", feet)
    if not names:
        raise InvalidInputError("feet: name at least one foot that stands on the ground")
    for name in names:
        robot.foot(name)
    return names


def standing_feet(
    robot: Robot,
    soles: Mapping[str, Array],
    names: tuple[str, ...],
    fixed: bool,
    planted: NDArray[np.intp] | None,
    flight: Bools,
    cop: Array,
    height: float,
    time: Array,
) -> tuple[Bools, SupportMargin | None]:
    """Return which feet stand (n, f), and the CoP's margin, None if there are no feet.

    ``soles``: placement of each foot's sole (n, 4, 4).
    ``fixed``: whether the named feet stand all the time, rather than those near the ground.
    ``planted``: the planted foot (n,), which always stands unless ``fixed``.
    """
    count = len(flight)
    if not names:
        return np.zeros((count, 0), dtype=bool), None
    columns = [tuple(robot.feet).index(name) for name in names]
    corners = sole_corners(robot, soles)[:, columns]
    touching = np.ones(corners.shape[:3], dtype=bool)
    if not fixed:
        touching = touching_corners(corners, height, time)
        if planted is not None:
            touching |= (planted[:, None] == np.array(columns))[..., None]
        touching &= ~flight[:, None, None]
    return np.asarray(touching.any(axis=2)), support_margins(corners, touching, cop)


def sole_corners(robot: Robot, soles: Mapping[str, Array]) -> Array:
    """Return the corners (n, f, k, 3) [m] of all soles; soles with fewer repeat their last one."""
    most = max(len(foot.polygon) for foot in robot.feet.values())
    parts = []
    for name, foot in robot.feet.items():
        polygon = foot.polygon[np.minimum(np.arange(most), len(foot.polygon) - 1)]
        flat = np.column_stack((polygon, np.zeros(most), np.ones(most)))  # (k, 4)
        parts.append((flat @ np.swapaxes(soles[name], 1, 2))[..., :3])
    return np.stack(parts, axis=1)


def touching_corners(corners: Array, height: float, time: Array) -> NDArray[np.bool_]:
    """Return which corners (n, f, k) of soles touch the ground.

    All of a sole that is within 1 cm of it; of others the corners that are, and do not slide: soles
    roll over their heels and toes.
    """
    low = np.abs(corners[..., 2] - height) <= MAX_SOLE_HEIGHT
    flat = low.all(axis=2, keepdims=True)
    if len(time) < 2:
        return low & flat
    speed = np.linalg.norm(np.gradient(corners[..., :2], time, axis=0), axis=-1)
    return flat | (low & (speed <= MAX_ROLLING_SPEED))


def support_margins(corners: Array, touching: NDArray[np.bool_], points: Array) -> SupportMargin:
    """Return the distance of points inside the hull of the corners that touch the ground.

    Negative outside, NaN where none touches; else as :func:`wbc.polygon.polygon_margin`.

    ``corners``: corners of the soles (n, f, k, 3) [m].
    ``touching``: which of them touch (n, f, k).
    ``points``: (n, 2) or more columns [m].
    """
    count, feet, each = corners.shape[:3]
    margins, gradients = np.full(count, np.nan), np.full((count, 2), np.nan)
    weights = np.zeros((count, feet))
    some = np.flatnonzero(touching.any(axis=(1, 2)))
    if len(some):
        chosen = corners[some][..., :2].reshape(len(some), -1, 2)
        touch = touching[some].reshape(len(some), -1)
        # Corners that do not touch are replaced by one that does.
        own = np.where(touch, np.arange(feet * each), touch.argmax(axis=1)[:, None])
        for part in range(0, len(some), FRAMES_PER_BATCH):
            rows = slice(part, part + FRAMES_PER_BATCH)
            at, inner = some[rows], np.arange(len(some[rows]))
            hull = np.take_along_axis(chosen[rows], own[rows, :, None], axis=1)
            margins[at], gradients[at], start, end, along = _margins(hull, points[at, :2])
            for corner, weight in ((start, 1.0 - along), (end, along)):
                weights[at, own[rows][inner, corner] // each] += weight
    return SupportMargin(margins, gradients, weights)


def _margins(corners: Array, points: Array) -> tuple[Array, ...]:
    """Return the margins of points (n, 2) in the hulls of corners (n, k, 2), and the nearest edge.

    That is, the margin (n,), its gradient (n, 2), the nearest edge's first and last corner (n,),
    and how far along it the nearest point is (n,), from 0 to 1.

    A line from one corner to another is an edge of the hull if no corner is to its right, so hulls
    need not be built. A segment or a point has edges in both directions and no interior.
    """
    (x, y), (px, py) = corners.transpose(2, 1, 0), points.T  # (k, n) and (n,): frames last
    nearest, frames = np.full(len(px), np.inf), np.arange(len(px))
    offset, fraction = np.zeros((2, len(px))), np.zeros(len(px))
    start, end = np.zeros((2, len(px)), dtype=int)
    inside, area = np.ones(len(px), bool), np.zeros(len(px), bool)
    for k in range(len(x)):
        dx, dy, ax, ay = x - x[k], y - y[k], px - x[k], py - y[k]
        length = np.hypot(dx, dy)
        apart = length > SAME_CORNER
        dx, dy = np.where(apart, (dx, dy), 0.0) / np.where(apart, length, 1.0)  # directions
        left = dx[:, None] * dy - dy[:, None] * dx  # sines (k, k, n), of corners from each line
        edge = (left.min(axis=1) >= -COLLINEAR) & apart
        area |= (edge & (left.max(axis=1) > COLLINEAR)).any(axis=0)
        edge[k] = ~apart.any(axis=0)  # all corners coincide
        along = np.clip(ax * dx + ay * dy, 0.0, length)
        from_edge = ax - along * dx, ay - along * dy
        away = np.where(edge, np.hypot(*from_edge), np.inf)
        least = away.argmin(axis=0), frames
        closer = (away[least] < nearest) | np.isnan(away[least])  # of a point that is NaN
        nearest = np.where(closer, away[least], nearest)
        offset = np.where(closer, [part[least] for part in from_edge], offset)
        fraction = np.where(closer, along[least] / np.maximum(length[least], SAME_CORNER), fraction)
        start, end = np.where(closer, k, start), np.where(closer, least[0], end)
        inside &= ((dx * ay - dy * ax >= 0.0) | ~edge).all(axis=0)
    sign = np.where(inside & area, 1.0, -1.0)
    gradient = sign * np.divide(offset, nearest, out=np.zeros_like(offset), where=nearest > 0.0)
    return sign * nearest, gradient.T, start, end, fraction
