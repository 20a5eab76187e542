"""A plan's schedule: contact phases with their supports, durations and limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.polygon import checked_polygon, convex_hull, half_planes
from wbc.rmp.plan.state import State
from wbc.validate import Array, finite_array, finite_number, interval

Corners = tuple[tuple[float, float], ...]
Range = tuple[float, float]
FREE = math.inf
# Polygons closer than this share a point [m].
TOUCHING = 1e-9
MOST_INTERVALS = 1000  # of a phase
# Corners farther from the origin are refused [m]: squares of their distances overflow.
FARTHEST = 1e9


@dataclass(frozen=True)
class Limits:
    """Limits that hold at every moment of a phase, not only at its knots.

    Those on ground forces are idle in flight.

    Parameters
    ----------
    friction:
        Largest |horizontal| / vertical ground force, > 0.
    torsion:
        Largest |moment about the vertical| / vertical ground force [m], >= 0; a foot's lever.
    normal_force:
        (least, greatest) vertical ground force in stance [N]. A least above zero keeps the contact.
    force:
        Greatest size of the ground force [N], > 0.
    leg_length:
        (least, greatest) distance from the CoP to the CoM [m], > 0. Along it the leg only pushes.
    torque:
        Greatest |k_G'| [N m], > 0: the torque between leg and masses, and so a bound for every
        wheel motor, whatever the orientation of its axis.
    momentum:
        Greatest size of each component of k_G [kg m^2/s], world axes, > 0.
    radius:
        (least, greatest) distance of masses from the CoM [m], > 0. Bounded by default: where little
        is given, nothing else keeps the masses from going kilometres away.
    radius_rate, radius_acceleration:
        Greatest size of r' [m/s] and r'' [m/s^2] of every pair, > 0.
    height:
        (least, greatest) height of the CoM [m].

    Raises
    ------
    InvalidInputError
        Numbers that are no limits: NaN, not positive where they must be, or in the wrong order.
    """

    friction: float = FREE
    torsion: float = 0.0
    normal_force: Range = (0.0, FREE)
    force: float = FREE
    leg_length: Range = (1e-2, FREE)
    torque: float = FREE
    momentum: float = FREE
    radius: Range = (1e-2, 1.0)
    radius_rate: float = FREE
    radius_acceleration: float = FREE
    height: Range = (0.0, FREE)

    def __post_init__(self) -> None:
        for each in fields(self):
            name, value = each.name, getattr(self, each.name)
            if isinstance(each.default, tuple):
                value = interval(f"limits: {name}", value, positive=each.default[0] > 0.0)
            elif value != FREE:
                above, least = (-FREE, 0.0) if name == "torsion" else (0.0, -FREE)
                value = finite_number(f"limits: {name}", value, above=above, least=least)
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class Phase:
    """One phase of the schedule.

    Parameters
    ----------
    name:
        For messages and results; not empty.
    duration:
        [s], > 0; or a pair (least, greatest), between which the planner chooses.
    support:
        Corners (k, 2) [m] of the support polygon on the ground z = 0, anticlockwise, world axes;
        two corners are an edge and one is a point. None is flight.
    intervals:
        Number of equal intervals of time, 1 to 1000; knots are their ends.
    limits:
        In place of the problem's for this phase.
    end:
        Components of the state that are given where the phase ends.

    Raises
    ------
    InvalidInputError
        A value that is none of the above; the message names the phase.
    """

    name: str
    duration: float | tuple[float, float]
    support: Corners | None
    intervals: int = 10
    limits: Limits | None = None
    end: State = field(default_factory=State)

    def __post_init__(self) -> None:
        where = f"phase {self.name!r}"
        if not isinstance(self.name, str) or not self.name:
            raise InvalidInputError(f"phase: needs a name, got {self.name!r}")
        if isinstance(self.intervals, bool) or not isinstance(self.intervals, int):
            raise InvalidInputError(f"{where}: intervals must be an integer")
        if self.intervals < 1:
            raise InvalidInputError(f"{where}: intervals must be 1 at least, got {self.intervals}")
        if self.intervals > MOST_INTERVALS:
            raise InvalidInputError(f"{where}: intervals must be {MOST_INTERVALS} at most")
        object.__setattr__(self, "duration", _duration(where, self.duration))
        if self.support is not None:
            try:
                # Corners on a side, or given twice, are left out.
                corners = np.array(self.support, dtype=float)
                if np.abs(corners).max(initial=0.0) > FARTHEST:
                    raise InvalidInputError(f"a corner farther away than {FARTHEST:g} m")
                support = hull(checked_polygon(corners))
                sides = np.subtract(support, np.roll(support, 1, axis=0))
                if len(support) > 1 and np.abs(sides).max(axis=1).min() < TOUCHING:
                    raise InvalidInputError(f"corners nearer than {TOUCHING:g} m to each other")
                support_bounds(support)
            except (InvalidInputError, ValueError, TypeError) as error:
                raise InvalidInputError(f"{where}: support: {error}") from error
            object.__setattr__(self, "support", support)

    @property
    def flies(self) -> bool:
        """True if nothing touches the ground."""
        return self.support is None

    @property
    def durations(self) -> tuple[float, float]:
        """(least, greatest) duration [s]; equal where it is fixed."""
        if isinstance(self.duration, tuple):
            return self.duration
        return self.duration, self.duration


def _duration(where: str, value: float | Sequence[float]) -> float | tuple[float, float]:
    if not isinstance(value, list | tuple):
        return finite_number(f"{where}: duration", value, above=0.0)
    if len(value) != 2:
        raise InvalidInputError(f"{where}: duration must be a number or (least, greatest)")
    low, high = (finite_number(f"{where}: duration", x, above=0.0) for x in value)
    if low > high:
        raise InvalidInputError(
            f"{where}: durations are crossed: the least, {low:g} s, exceeds the greatest, {high:g}"
        )
    return (low, high) if low < high else low


def hull(*feet: ArrayLike) -> Corners:
    """Return the convex hull of feet, each (k, 2) [m], as corners of a support polygon.

    Raises
    ------
    InvalidInputError
        No points, or not finite.
    """
    if not feet:
        raise InvalidInputError("hull: needs at least one foot")
    points = np.vstack([finite_array("foot", foot, np.shape(foot)) for foot in feet])
    return tuple((float(x), float(y)) for x, y in convex_hull(points))


def rectangle(x: float, y: float, length: float, width: float) -> Corners:
    """Return the corners of a foot's sole about (x, y), sides along the axes [m].

    Raises
    ------
    InvalidInputError
        A side that is not positive.
    """
    a = finite_number("length", length, above=0.0) / 2.0
    b = finite_number("width", width, above=0.0) / 2.0
    return ((x - a, y - b), (x + a, y - b), (x + a, y + b), (x - a, y + b))


def support_bounds(support: Corners) -> tuple[Array, Array, Array]:
    """Return (A, l, u): the support is l <= A p <= u. Rows are unit vectors, bounds in metres."""
    corners = np.array(support)
    if len(corners) == 1:
        return np.eye(2), corners[0], corners[0].copy()
    if len(corners) == 2:
        x, y = (corners[1] - corners[0]) / np.linalg.norm(corners[1] - corners[0])
        A = np.array(((x, y), (-y, x)))
        ends = corners @ A.T
        return A, ends.min(axis=0), ends.max(axis=0)
    normals, offsets = half_planes(corners)
    return normals, np.full(len(offsets), -np.inf), offsets


def overlap(a: Corners, b: Corners) -> bool:
    """Tell whether two convex supports share a point, by their separating axes."""
    one, other = np.array(a), np.array(b)
    axes = [support_bounds(a)[0], support_bounds(b)[0]]
    if len(a) == 1 and len(b) == 1 and a != b:
        axes.append((other - one) / np.linalg.norm(other - one))
    for axis in np.vstack(axes):
        p, q = one @ axis, other @ axis
        if p.max() < q.min() - TOUCHING or q.max() < p.min() - TOUCHING:
            return False
    return True
