"""How hard a push a standing pendulum can absorb without a step (linear inverted pendulum).

With the CoM at constant height z the ground pushes along the line from the centroidal moment pivot
(CMP) to the CoM, and the capture point xi = c + c'/omega, omega = sqrt(g/z), runs away from it:

    c'' = omega^2 (c - cmp),    xi' = omega (xi - cmp),
    xi(0) = integral over s > 0 of omega e^(-omega s) cmp(s)

for every motion that stays near (Koolen et al., Int. J. Robotics Research 31(9), 2012). So what can
be caught is the set of such weighted means of the CMP. It is the sum of two sets:

- of the CoP, which may be anywhere in the support polygon: the polygon itself;
- of the wheel's part I theta''/(M g). Integrated by parts it is proportional to the integral of
  e^(-omega s) theta(s), so that no motion does better than one whose angle is as large as it can be
  at every instant: full torque, full brake, stop at the angle's limit (bang-bang), and stay.

A push at rest makes xi jump by impulse / (M omega). Left out: friction, the leg's length and force,
and that turns about two axes do not commute; these make the true bound smaller or larger.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.kinds import check_kind
from wbc.polygon import half_planes
from wbc.rmp.balance.law import FREE
from wbc.spatial import STANDARD_GRAVITY
from wbc.validate import (
    Array,
    check_fields,
    finite_array,
    finite_number,
    finite_vector,
    read_only,
    real_array,
    set_fields,
)

_AXES = np.array(((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)))


@dataclass(frozen=True, eq=False)
class Wheel:
    """A reaction mass with one motor for each horizontal axis, and the greatest that it can do.

    Raises InvalidInputError: a number that is not positive, or a torque that is not finite.
    """

    inertia: ArrayLike  # about x and y (2,) [kg m^2]; one number for both
    torque: float  # about each axis [N m]
    angle: float = FREE  # [rad]
    rate: float = FREE  # [rad/s]

    def __post_init__(self) -> None:
        inertia = real_array("wheel: inertia", self.inertia)
        both = np.full(2, inertia) if inertia.ndim == 0 else inertia
        inertia = finite_vector("wheel: inertia", both, 2)
        if inertia.min() <= 0.0:
            raise InvalidInputError(f"wheel: inertia must be positive, got {inertia} kg m^2")
        set_fields(self, inertia=read_only(inertia))
        check_fields(self, "wheel: ", "torque", above=0.0)
        check_fields(self, "wheel: ", "angle", "rate", above=0.0, unlimited=True)

    def reach(self, weight: float, omega: float) -> Array:
        """Return by how much each axis shifts the capture points that can be caught (2,) [m].

        Full torque for t1, none until t2, full brake: tau/(M g) (1 - e^(-omega t1)) (1 - e^(-omega
        t2)). Where the rate's limit is not met, t1 = t2 = sqrt(angle I / tau): theory's bang-bang.
        ``weight`` is M g [N], ``omega`` sqrt(g / z) [1/s].
        """
        I = np.asarray(self.inertia)  # noqa: E741
        faster = np.minimum(np.sqrt(self.angle * I / self.torque), self.rate * I / self.torque)
        # Without any limit the wheel just speeds up forever: t1 is infinite, and so is t2.
        with np.errstate(invalid="ignore"):
            brake = np.where(np.isinf(faster), FREE, self.angle * I / (self.torque * faster))
        shift = np.expm1(-omega * faster) * np.expm1(-omega * brake)
        return np.asarray(self.torque / weight * shift)


@dataclass(frozen=True, eq=False)
class PushLimits:
    """Largest impulses [N s], one for each direction.

    With the CoP alone (``ankle``) they are M omega d, d the way from the CoM's projection to the
    edge. With the wheel the support polygon is enlarged by the box of what both motors can do, each
    up to its own limits: along x or y, with an edge across, M omega (d + reach).
    """

    directions: Array  # unit vectors (n, 2)
    ankle: Array  # (n,)
    wheel: Array  # (n,)
    omega: float  # sqrt(g / z) [1/s]


def push_limits(
    directions: ArrayLike,
    polygon: ArrayLike,
    wheel: Wheel,
    *,
    mass: float,
    height: float,
    com: ArrayLike = (0.0, 0.0),
    gravity: float = STANDARD_GRAVITY,
) -> PushLimits:
    """Return the largest impulses that a pendulum at rest absorbs without a step.

    Parameters
    ----------
    directions:
        Of the push (n, 2), of any length but zero.
    polygon:
        Support polygon (k, 2) [m], convex, anticlockwise, k >= 3.
    mass, height, com:
        M [kg]; CoM above the ground [m]; its projection (2,), inside the polygon [m].
    gravity:
        [m/s^2].

    Raises
    ------
    InvalidInputError
        Wrong sizes or signs, not finite, or a CoM that is not above the polygon.
    """
    check_kind("wheel", wheel, Wheel, "Wheel(inertia, torque)")
    mass = finite_number("mass", mass, above=0.0)
    gravity = finite_number("gravity", gravity, above=0.0)
    omega = math.sqrt(gravity / finite_number("height", height, above=0.0))
    along = unit_directions(directions)
    normals, offsets = half_planes(polygon)
    clearance = offsets - normals @ finite_vector("com", com, 2)
    if clearance.min() < 0.0:
        raise InvalidInputError(
            f"com: its projection is {-clearance.min():.3g} m outside the polygon; it falls by"
            " itself"
        )
    # A turn about x shifts the CMP along y.
    sides = wheel.reach(mass * gravity, omega)[::-1]
    edges = np.concatenate((normals, _AXES))
    support = np.concatenate((offsets, (_AXES @ np.asarray(polygon, dtype=float).T).max(axis=1)))
    wider = support + np.abs(edges) @ sides - edges @ np.asarray(com, dtype=float)
    scale = mass * omega
    return PushLimits(
        directions=read_only(along),
        ankle=read_only(scale * _exit(normals, clearance, along)),
        wheel=read_only(scale * _exit(edges, wider, along)),
        omega=omega,
    )


def compass(count: int) -> Array:
    """Return unit vectors (count, 2), evenly around, the x axis first."""
    angles = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack((np.cos(angles), np.sin(angles)))


def unit_directions(directions: ArrayLike) -> Array:
    """Return directions (n, 2) at unit length; InvalidInputError if one has none."""
    along = real_array("directions", directions)
    along = finite_array("directions", along, (len(np.atleast_2d(along)), 2))
    lengths = np.linalg.norm(along, axis=1)
    if lengths.min(initial=1.0) == 0.0:
        raise InvalidInputError(f"directions[{int(lengths.argmin())}]: has no length")
    return np.asarray(along / lengths[:, None])


def _exit(normals: Array, clearance: Array, along: Array) -> Array:
    """Return how far (n,) along each direction the first half-plane ends."""
    speed = along @ normals.T  # (n, k)
    # Rounding of a parallel edge must not make it one that is met far away, or at once.
    ahead = speed > 1e-12
    distance = np.divide(clearance, speed, out=np.full(speed.shape, np.inf), where=ahead)
    return np.asarray(distance.min(axis=1))
