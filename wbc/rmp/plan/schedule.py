"""A plan's schedule: contact phases with supports, durations, limits, and states at their ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.kinds import check_kind
from wbc.polygon import checked_polygon, convex_hull, half_planes
from wbc.validate import (
    Array,
    check_fields,
    check_unmasked,
    finite_array,
    finite_number,
    finite_vector,
    interval,
    real_array,
    set_fields,
)

Components = Sequence[float | None]
# Names of a plan's states, each with three components; the orientation's are Rodrigues parameters.
STATE = ("com", "com_velocity", "orientation", "momentum", "radii", "radii_rates")
# How far a principal moment may exceed the sum of the others by rounding, as a fraction.
ROUNDING = 1e-9
Corners = tuple[tuple[float, float], ...]
Range = tuple[float, float]
FREE = math.inf
# Polygons closer than this share a point [m].
TOUCHING = 1e-9
MOST_INTERVALS = 1000  # of a phase
# Corners farther from the origin are refused [m]: squares of their distances overflow.
FARTHEST = 1e9


@dataclass(frozen=True)
class State:
    """Components of a state of the solid pendulum; None, for all or one of three, leaves it free.

    Parameters
    ----------
    com, com_velocity:
        c [m] and c' [m/s].
    rotation:
        Orientation of the masses as a rotation vector [rad] from the problem's ``reference``.
        Its length is the angle, below 2 pi. Give all three components, or zeros with others free:
        (0, 0, None) is any rotation about z.
    momentum:
        Angular momentum about the CoM, k_G [kg m^2/s], world axes.
    radii, radii_rates:
        r [m] and r' [m/s].
    inertia:
        Principal moments of inertia about the masses' axes [kg m^2], all three, in place of radii.

    Raises
    ------
    InvalidInputError
        Not three numbers or None, not finite, an angle too large, radii that are not positive, or
        moments of inertia that no body can have.
    """

    com: Components | None = None
    com_velocity: Components | None = None
    rotation: Components | None = None
    momentum: Components | None = None
    radii: Components | None = None
    radii_rates: Components | None = None
    inertia: Components | None = None

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if value is not None:
                set_fields(self, **{each.name: _components(each.name, value)})
        _check_rotation(self.rotation)
        if any(r is not None and r <= 0.0 for r in self.radii or ()):
            raise InvalidInputError(f"state: radii must be positive, got {self.radii}")
        if self.inertia is not None:
            if self.radii is not None:
                raise InvalidInputError("state: give radii or inertia, not both")
            if None in self.inertia:
                raise InvalidInputError("state: inertia needs all three principal moments")
            radii_for(1.0, self.inertia)

    def values(self, mass: float) -> dict[str, Array]:
        """Return the given of :data:`STATE` (3,), NaN where free; orientation as parameters."""
        given = {
            name: np.array(getattr(self, name), dtype=float)
            for name in ("com", "com_velocity", "momentum", "radii", "radii_rates")
            if getattr(self, name) is not None
        }
        if self.rotation is not None:
            rotation = np.array(self.rotation, dtype=float)
            given["orientation"] = rotation if None in self.rotation else mrp_of(rotation)
        if self.inertia is not None:
            given["radii"] = radii_for(mass, self.inertia)
        return given


def at_rest(com: Components, radii: Components) -> State:
    """Return the state at rest, in the reference orientation."""
    still = (0.0, 0.0, 0.0)
    return State(com, still, still, still, radii, still)


def radii_for(mass: float, inertia: Components) -> Array:
    """Return the radii (3,) [m] of masses with given principal moments of inertia.

    I_i = M/3 (r_j^2 + r_k^2), so r_k^2 = 3/(2 M) (I_i + I_j - I_k).

    Raises
    ------
    InvalidInputError
        A mass or moment that is not positive, or a moment not below the sum of the others.
    """
    mass = finite_number("mass", mass, above=0.0)
    moments = finite_vector("inertia", real_array("inertia", inertia), 3)
    spare = moments.sum() - 2.0 * moments
    if moments.min() <= 0.0:
        raise InvalidInputError(f"inertia: moments must be positive, got {moments} kg m^2")
    if spare.min() <= ROUNDING * moments.max():
        raise InvalidInputError(
            f"inertia: moments {moments} kg m^2 break the triangle inequality: each must be less"
            " than the sum of the others, or some radius would be zero or imaginary"
        )
    return np.sqrt(1.5 / mass * spare)


def mrp_of(rotation: Array) -> Array:
    """Return the modified Rodrigues parameters (3,), axis tan(angle/4), of a rotation vector."""
    angle = float(np.linalg.norm(rotation))
    return rotation * (0.25 if angle == 0.0 else np.tan(angle / 4.0) / angle)


def _check_rotation(rotation: Components | None) -> None:
    if rotation is None or (None in rotation and not any(rotation)):
        return
    if None in rotation:
        raise InvalidInputError(
            "state: rotation needs all three components, or zeros where others are free"
        )
    turn = float(np.linalg.norm(np.array(rotation, dtype=float)))
    if turn >= 2.0 * np.pi:
        raise InvalidInputError(
            f"state: a rotation of {turn:.4g} rad from the reference reaches a full turn, where"
            " the orientation's parameters are singular; put the problem's reference in the"
            " middle of the turn, so that it runs from -turn/2 to turn/2"
        )


def _components(name: str, value: Components) -> tuple[float | None, ...]:
    check_unmasked(f"state: {name}", value)
    if isinstance(value, str) or np.shape(np.array(value, dtype=object)) != (3,):
        raise InvalidInputError(f"state: {name} must be three numbers (or null), got {value!r}")
    return tuple(None if x is None else finite_number(f"state: {name}", x) for x in value)


@dataclass(frozen=True)
class PathLimits:
    """Limits at every time of a phase, not only at its knots.

    Those on ground forces have no effect in flight.

    Parameters
    ----------
    friction:
        Largest |horizontal| / vertical ground force, > 0.
    torsion:
        Largest |moment about the vertical| / vertical ground force [m], >= 0; a foot's lever.
    normal_force:
        (least, greatest) vertical ground force in stance [N]. A least value above zero maintains
        contact.
    force:
        Greatest size of the ground force [N], > 0.
    leg_length:
        (least, greatest) distance from the CoP to the CoM [m], > 0. The leg can only push.
    torque:
        Greatest |k_G'| [N m], > 0: the torque between leg and masses, and so a bound for every
        wheel motor, whatever the orientation of its axis.
    momentum:
        Greatest size of each component of k_G [kg m^2/s], world axes, > 0.
    radius:
        (least, greatest) distance of masses from the CoM [m], > 0. Bounded by default, as otherwise
        little may keep the masses from moving away by kilometres.
    radius_rate, radius_acceleration:
        Greatest size of r' [m/s] and r'' [m/s^2] of every pair, > 0.
    height:
        (least, greatest) height of the CoM [m].

    Raises
    ------
    InvalidInputError
        Invalid limits: NaN, not positive where they must be, or in the wrong order.
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
                pair = interval(f"limits: {name}", value, positive=each.default[0] > 0.0)
                set_fields(self, **{name: pair})
            else:
                above, least = (-FREE, 0.0) if name == "torsion" else (0.0, -FREE)
                check_fields(self, "limits: ", name, above=above, least=least, unlimited=True)


@dataclass(frozen=True)
class PlanPhase:
    """One phase of the schedule.

    Raises
    ------
    InvalidInputError
        An invalid value; the message names the phase.
    """

    name: str  # for messages and results; not empty
    duration: float | Range  # [s], > 0; of (least, greatest) the planner chooses
    # Corners (k, 2) [m] of the support polygon on the ground z = 0, anticlockwise, world axes; two
    # corners are an edge and one is a point. None is flight.
    support: Corners | None
    intervals: int = 10  # equal intervals of time, 1 to 1000; knots are their ends
    limits: PathLimits | None = None  # in place of the problem's for this phase
    end: State = field(default_factory=State)  # fixed components at the end of the phase

    def __post_init__(self) -> None:
        where = f"phase {self.name!r}"
        if not isinstance(self.name, str) or not self.name:
            raise InvalidInputError(f"phase: needs a name, got {self.name!r}")
        n = self.intervals
        if isinstance(n, bool) or not isinstance(n, int) or not 1 <= n <= MOST_INTERVALS:
            raise InvalidInputError(
                f"{where}: intervals must be an integer from 1 to {MOST_INTERVALS}, got {n!r}"
            )
        check_kind(
            f"{where}: limits", self.limits, PathLimits, "PathLimits(friction=0.6)", or_none=True
        )
        check_kind(f"{where}: end", self.end, State, "State(com=(0.0, 0.0, 0.7))")
        set_fields(self, duration=_duration(where, self.duration))
        if self.support is not None:
            try:
                # Corners on a side, and duplicates, are dropped.
                corners = real_array("corners", self.support)
                if np.abs(corners).max(initial=0.0) > FARTHEST:
                    raise InvalidInputError(f"a corner farther away than {FARTHEST:g} m")
                support = hull(checked_polygon(corners))
                sides = np.subtract(support, np.roll(support, 1, axis=0))
                if len(support) > 1 and np.abs(sides).max(axis=1).min() < TOUCHING:
                    raise InvalidInputError(f"corners nearer than {TOUCHING:g} m to each other")
                support_bounds(support)
            except (InvalidInputError, ValueError, TypeError) as error:
                raise InvalidInputError(f"{where}: support: {error}") from error
            set_fields(self, support=support)

    @property
    def flies(self) -> bool:
        """True if nothing touches the ground."""
        return self.support is None

    @property
    def durations(self) -> Range:
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
    given = [real_array("foot", foot) for foot in feet]
    corners = [finite_array("foot", one, (max(len(np.atleast_1d(one)), 1), 2)) for one in given]
    return tuple((float(x), float(y)) for x, y in convex_hull(np.vstack(corners)))


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
    """Return whether two convex supports share a point, by their separating axes."""
    one, other = np.array(a), np.array(b)
    axes = [support_bounds(a)[0], support_bounds(b)[0]]
    if len(a) == 1 and len(b) == 1 and a != b:
        axes.append((other - one) / np.linalg.norm(other - one))
    for axis in np.vstack(axes):
        p, q = one @ axis, other @ axis
        if p.max() < q.min() - TOUCHING or q.max() < p.min() - TOUCHING:
            return False
    return True
