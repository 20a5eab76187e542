"""What the pendulum may do in a phase of a plan: friction, leg, torque, radii, height."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from wbc.validate import finite_number, interval

FREE = math.inf
Range = tuple[float, float]
_RANGES = ("normal_force", "leg_length", "radius", "height")


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
        (least, greatest) distance of masses from the CoM [m], > 0.
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
    radius: Range = (1e-2, FREE)
    radius_rate: float = FREE
    radius_acceleration: float = FREE
    height: Range = (0.0, FREE)

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name in _RANGES:
                positive = each.name in ("leg_length", "radius")
                pair = interval(f"limits: {each.name}", value, positive=positive)
                object.__setattr__(self, each.name, pair)
            else:
                object.__setattr__(self, each.name, _size(each.name, value))


def _size(name: str, value: float) -> float:
    if value == FREE:
        return FREE
    if name == "torsion":
        return finite_number("limits: torsion", value, least=0.0)
    return finite_number(f"limits: {name}", value, above=0.0)
