"""Where a standing pendulum's CMP should be: the capture point law, as a law's symbols."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from wbc.errors import InvalidInputError
from wbc.validate import Array, check_fields


@dataclass(frozen=True)
class CaptureGains:
    """How hard the capture point is driven, and how the rest follows."""

    capture: float = 2.5  # k of cmp = xi + k (xi - xi_ref) while the CoP alone can do it
    # How far the CMP is asked beyond the support, for each metre that xi is: the wheel's share.
    # Large: a torque kept back at first cannot be made up for later.
    beyond: float = 60.0
    reserve: float = 0.02  # part of the support, at its edge, where the wheel already helps, > 0
    height: float = 8.0  # natural frequency of the CoM's height [rad/s], critically damped
    wheel: float = 4.0  # natural frequency [rad/s] at which the masses turn back to rest
    radii: float = 8.0  # and at which they slide back [rad/s]

    def __post_init__(self) -> None:
        positive = ("capture", "beyond", "height", "wheel", "radii")
        check_fields(self, "gains: ", *positive, above=0.0)
        if not 0.0 < self.reserve < 1.0:
            raise InvalidInputError(f"gains: reserve must be in (0, 1), got {self.reserve:g}")


def braking_debt(momentum: ca.SX, torque: float, weight: float, omega: ca.SX) -> ca.SX:
    """Return how far (2,) [m] the capture point will be set back when the wheel is stopped.

    Full brake takes |k_G| / torque and shifts the CMP by torque / weight meanwhile. A capture point
    is safe only if it is inside the support with this added: a law that stops pushing as soon as xi
    itself is inside finds itself outside again once the wheel must brake. ``momentum`` is k_G (3,)
    [kg m^2/s] in world axes, ``torque`` that of the motors [N m], ``weight`` M g [N].
    """
    # A torque about y moves the CMP along x, one about x moves it back along y.
    across = ca.vertcat(momentum[1], -momentum[0])
    share = 1.0 - ca.exp(-omega * ca.fabs(across) / torque)
    return torque / weight * ca.sign(across) * share


def wanted_cmp(
    capture_point: ca.SX, debt: ca.SX, target: Array, support: Array, gains: CaptureGains
) -> ca.SX:
    """Return the CMP (2,) wanted for a capture point (2,) [m].

    The wheel's share begins a little inside the support, where the CoP alone still drives the
    capture point back: began it at the edge itself, both would just hold it there. ``debt`` is
    that of :func:`braking_debt`, ``target`` (2,) the capture point at rest, and ``support`` holds
    the corners of the polygon (k, 2), anticlockwise.
    """
    near = projected(support, capture_point + gains.capture * (capture_point - ca.DM(target)))
    return near + gains.beyond * beyond_reserve(capture_point + debt, target, support, gains)


def beyond_reserve(point: ca.SX, target: Array, support: Array, gains: CaptureGains) -> ca.SX:
    """Return how far (2,) [m] a point is outside the support without its reserve."""
    return point - projected(target + (1.0 - gains.reserve) * (support - target), point)


def projected(corners: Array, point: ca.SX) -> ca.SX:
    """Return the point (2,) of a convex polygon (k, 2), anticlockwise, nearest to ``point``."""
    best, least, inside = point, ca.SX(ca.inf), ca.SX(1.0)
    for k in range(len(corners)):
        start, end = corners[k - 1], corners[k]
        along = ca.DM(end - start)
        arm = point - ca.DM(start)
        share = ca.fmax(0.0, ca.fmin(1.0, ca.dot(arm, along) / ca.sumsqr(along)))
        foot = ca.DM(start) + share * along
        distance = ca.sumsqr(point - foot)
        best = ca.if_else(distance < least, foot, best)
        least = ca.fmin(distance, least)
        inside *= along[0] * arm[1] - along[1] * arm[0] >= 0.0
    return ca.if_else(inside, point, best)
