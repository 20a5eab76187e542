"""What a pendulum may do: its foot, its friction, its leg, its motors and its strokes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.polygon import checked_polygon
from wbc.validate import Array, finite_number, interval, read_only

FREE = math.inf


@dataclass(frozen=True, eq=False)
class Bounds:
    """Limits that a balance law respects and a simulation judges by.

    Parameters
    ----------
    polygon:
        Support polygon on the ground, world axes: corners (k, 2) [m], anticlockwise, for a solid
        pendulum; (least x, greatest x) (2,) for a planar one. None: a foot without extent, so the
        CoP stays where the leg stands.
    friction:
        Largest |horizontal| / vertical ground force, > 0.
    leg_force:
        (least, greatest) force along the leg [N]; a leg that only pushes has 0 as the least.
    leg_length:
        (least, greatest) length of the leg [m], > 0.
    wheel_torque:
        Greatest torque between leg and masses about each axis of the masses [N m], > 0.
    wheel_angle:
        Greatest angle of the masses from where they rest, about each axis [rad], > 0.
    wheel_rate:
        Greatest rate of that angle [rad/s], > 0.
    radius:
        (least, greatest) distance of the masses from the CoM [m], 0 < least < greatest.

    Raises
    ------
    InvalidInputError
        Numbers that are no limits: not finite where they must be, or in the wrong order.
    """

    polygon: ArrayLike | None = None
    friction: float = FREE
    leg_force: tuple[float, float] = (0.0, FREE)
    leg_length: tuple[float, float] = (1e-3, FREE)
    wheel_torque: float = FREE
    wheel_angle: float = FREE
    wheel_rate: float = FREE
    radius: tuple[float, float] = (1e-3, FREE)

    def __post_init__(self) -> None:
        if self.polygon is not None:
            object.__setattr__(self, "polygon", read_only(_support(self.polygon)))
        for name in ("friction", "wheel_torque", "wheel_angle", "wheel_rate"):
            if getattr(self, name) != FREE:
                object.__setattr__(
                    self, name, finite_number(f"bounds: {name}", getattr(self, name), above=0.0)
                )
        for name in ("leg_force", "leg_length", "radius"):
            pair = interval(f"bounds: {name}", getattr(self, name), positive=name != "leg_force")
            object.__setattr__(self, name, pair)


def _support(polygon: ArrayLike) -> Array:
    flat = np.asarray(polygon, dtype=float)
    if flat.shape != (2,):
        return checked_polygon(polygon)
    least, greatest = (finite_number("bounds: polygon", x) for x in flat.tolist())
    if least > greatest:
        raise InvalidInputError(f"bounds: polygon runs from {least:g} to {greatest:g} m; swap them")
    return np.array((least, greatest))
