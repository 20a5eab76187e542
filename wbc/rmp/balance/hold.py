"""Leg and radius of a planar pendulum held stiff by computed forces: what is left is a wheel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import Pendulum
from wbc.rmp.planar import PlanarRmp
from wbc.validate import Array, finite_number


@dataclass(frozen=True)
class Held:
    """A planar reaction wheel pendulum: length of the leg and radius of the masses stay.

    Parameters
    ----------
    model:
        The pendulum; M r_l^2 is the leg's inertia about the foot, M r^2 the wheel's.
    length, radius:
        Of leg and wheel [m], > 0.
    length_rate, radius_rate:
        Errors decay as (1 + rate t) e^(-rate t) [1/s], > 0. The radius needs the stiffer hold: the
        centrifugal force of a wheel that gains speed grows while a command is held.

    Raises
    ------
    InvalidInputError
        Not a planar pendulum, or a number that is not positive.
    """

    model: PlanarRmp
    length: float
    radius: float
    length_rate: float = 10.0
    radius_rate: float = 60.0

    def __post_init__(self) -> None:
        require_planar(self.model)
        for name in ("length", "radius", "length_rate", "radius_rate"):
            object.__setattr__(self, name, finite_number(name, getattr(self, name), above=0.0))

    @property
    def leg_inertia(self) -> float:
        """M r_l^2 [kg m^2]."""
        return self.model.mass * self.length**2

    @property
    def wheel_inertia(self) -> float:
        """M r^2 [kg m^2]."""
        return self.model.mass * self.radius**2

    @property
    def weight_torque(self) -> float:
        """M g r_l [N m]: the torque of gravity on a horizontal leg."""
        return self.model.mass * self.model.gravity * self.length

    @property
    def frequency(self) -> float:
        """sqrt(g / r_l) [1/s]: of the hanging leg, and the rate at which the upright one falls."""
        return float(np.sqrt(self.model.gravity / self.length))

    def forces(self, q: Array, v: Array, wheel_torque: float) -> Array:
        """Return f (4,) with that torque on the wheel and none at the foot (eqs. 20 and 21)."""
        M, g = self.model.mass, self.model.gravity
        _, theta, length, _, radius = q.tolist()
        _, theta_rate, length_rate, alpha_rate, radius_rate = v.tolist()
        leg = _return(length - self.length, length_rate, self.length_rate)
        masses = _return(radius - self.radius, radius_rate, self.radius_rate)
        f_l = M * (leg - length * theta_rate**2 + g * np.sin(theta))
        f = M * (masses - radius * (theta_rate + alpha_rate) ** 2)
        return np.array((0.0, f_l, wheel_torque, f))


def require_planar(model: Pendulum) -> None:
    """Raise InvalidInputError unless the pendulum is a planar one."""
    if not isinstance(model, PlanarRmp):
        raise InvalidInputError(f"model: this law needs a PlanarRmp, got {type(model).__name__}")


def _return(error: float, rate: float, decay: float) -> float:
    return -decay * (2.0 * rate + decay * error)
