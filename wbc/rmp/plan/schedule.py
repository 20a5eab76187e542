"""A plan's contact phases: for how long the pendulum stands on what, and when it flies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.polygon import checked_polygon
from wbc.rmp.plan.limits import Limits
from wbc.rmp.plan.state import State
from wbc.validate import Array, finite_array, finite_number

Corners = tuple[tuple[float, float], ...]
# Polygons closer than this share a point [m].
TOUCHING = 1e-9


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
        Number of equal intervals of time, >= 1; knots are their ends.
    limits:
        In place of the problem's for this phase.
    end:
        Components of the state that are given where the phase ends.

    Raises
    ------
    InvalidInputError
        Something that is not so; the message names the phase.
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
        object.__setattr__(self, "duration", _duration(where, self.duration))
        if self.support is not None:
            try:
                corners = checked_polygon(np.array(self.support, dtype=float))
            except (InvalidInputError, ValueError, TypeError) as error:
                raise InvalidInputError(f"{where}: support: {error}") from error
            # Corners that are none, on a side or twice, are left out.
            object.__setattr__(self, "support", hull(corners))

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
    unique = sorted({(float(x), float(y)) for x, y in points})
    lower, upper = _chain(unique), _chain(unique[::-1])
    return tuple(lower[:-1] + upper[:-1]) or tuple(unique)


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


def half_planes(support: Corners) -> tuple[Array, Array, Array]:
    """Return (A, l, u): the support is l <= A p <= u. Rows are unit vectors, bounds in metres."""
    corners = np.array(support)
    if len(corners) == 1:
        return np.eye(2), corners[0], corners[0].copy()
    edges = np.roll(corners, -1, axis=0) - corners
    along = edges / np.linalg.norm(edges, axis=1)[:, None]
    if len(corners) == 2:
        A = np.array((along[0], (-along[0, 1], along[0, 0])))
        ends = corners @ A.T
        return A, ends.min(axis=0), ends.max(axis=0)
    A = np.column_stack((along[:, 1], -along[:, 0]))  # outward
    u = (A @ corners.T).max(axis=1)
    return A, np.full(len(u), -np.inf), u


def overlap(a: Corners, b: Corners) -> bool:
    """Tell whether two convex supports share a point, by their separating axes."""
    one, other = np.array(a), np.array(b)
    axes = [half_planes(a)[0], half_planes(b)[0]]
    if len(a) == 1 and len(b) == 1 and a != b:
        axes.append((other - one) / np.linalg.norm(other - one))
    for axis in np.vstack(axes):
        p, q = one @ axis, other @ axis
        if p.max() < q.min() - TOUCHING or q.max() < p.min() - TOUCHING:
            return False
    return True


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


def _chain(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return one side of a hull (Andrew's monotone chain)."""
    chain: list[tuple[float, float]] = []
    for x, y in points:
        while len(chain) > 1:
            (x0, y0), (x1, y1) = chain[-2:]
            if (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0.0:
                break
            chain.pop()
        chain.append((x, y))
    return chain
