"""The interface of balance laws: from bounds and a pendulum's state to generalised forces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, shown
from wbc.kinds import check_kind
from wbc.polygon import checked_polygon
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import (
    Array,
    check_fields,
    finite_number,
    interval,
    read_only,
    real_array,
    set_fields,
)

FREE = math.inf
Pendulum = PlanarRmp | SolidRmp


@dataclass(frozen=True, eq=False)
class LawBounds:
    """Limits that a balance law respects and that a simulation checks.

    Parameters
    ----------
    polygon:
        Support polygon on the ground, world axes: corners (k, 2) [m], anticlockwise, for a solid
        pendulum; (least x, greatest x) (2,) for a planar one. None: a point foot, so the CoP stays
        at the leg's foot.
    cop_margin:
        How far inside the polygon laws keep the CoP [m]; simulations check the polygon itself. It
        covers the CoP's motion while a command is held, and errors: a torque at the ankle that is
        wrong by less than ``cop_margin`` M g does not tip a real foot. It reduces the push that a
        standing pendulum absorbs by M omega ``cop_margin``.
    friction:
        Largest |horizontal| / vertical ground force, > 0.
    torsion:
        Whether the law for pushes also limits the ground's torque about the vertical to that of
        friction at the corners of a rectangle: for real soles, which would else turn when loaded at
        a corner. The CoP may then alternate by millimetres between commands. Simulations do not
        check it, and all other laws refuse it.
    leg_force:
        (least, greatest) force along the leg [N]; the least is 0 for a leg that can only push.
    leg_length:
        (least, greatest) length of the leg [m], > 0.
    wheel_torque:
        Greatest torque between leg and masses about each axis of the masses [N m], > 0.
    wheel_angle:
        Greatest angle of the masses from their rest position, about each axis [rad], > 0.
    wheel_rate:
        Greatest rate of that angle [rad/s], > 0.
    radius:
        (least, greatest) distance of the masses from the CoM [m], 0 < least < greatest.

    Raises
    ------
    InvalidInputError
        Invalid limits: not finite where they must be, or in the wrong order.
    """

    polygon: ArrayLike | None = None
    cop_margin: float = 1e-3
    friction: float = FREE
    torsion: bool = False
    leg_force: tuple[float, float] = (0.0, FREE)
    leg_length: tuple[float, float] = (1e-3, FREE)
    wheel_torque: float = FREE
    wheel_angle: float = FREE
    wheel_rate: float = FREE
    radius: tuple[float, float] = (1e-3, FREE)

    def __post_init__(self) -> None:
        if self.polygon is not None:
            set_fields(self, polygon=read_only(_support(self.polygon)))
        check_fields(self, "bounds: ", "cop_margin", least=0.0)
        greatest = ("friction", "wheel_torque", "wheel_angle", "wheel_rate")
        check_fields(self, "bounds: ", *greatest, above=0.0, unlimited=True)
        for name in ("leg_force", "leg_length", "radius"):
            pair = interval(f"bounds: {name}", getattr(self, name), positive=name != "leg_force")
            set_fields(self, **{name: pair})


def check_law(law: BalanceLaw, bounds: LawBounds, *kinds: type) -> None:
    """Refuse a law's model that is of none of these kinds, and bounds that are none."""
    if not isinstance(law.model, kinds):
        names = " or ".join(kind.__name__ for kind in kinds)
        raise InvalidInputError(f"model: this law needs a {names}, got {shown(law.model)}")
    check_kind("bounds", bounds, LawBounds, "LawBounds()")


def refuse_torsion(bounds: LawBounds, law: object) -> None:
    """Raise an error if ``torsion`` is set, for laws that do not support it."""
    if bounds.torsion:
        raise InvalidInputError(
            f"bounds: {type(law).__name__} cannot keep torsion within what friction holds; leave it"
            " out, or use MomentumQp"
        )


def _support(polygon: ArrayLike) -> Array:
    flat = real_array("bounds: polygon", polygon)
    if flat.shape != (2,):
        return checked_polygon(flat)
    least, greatest = (finite_number("bounds: polygon", x) for x in flat.tolist())
    if least > greatest:
        raise InvalidInputError(f"bounds: polygon runs from {least:g} to {greatest:g} m; swap them")
    return np.array((least, greatest))


@dataclass(frozen=True, eq=False)
class PendulumCommand:
    """A balance law's command.

    In ``force``, ``tau_theta`` and ``tau_phi`` are the sum of the reaction of the wheel's torque on
    the leg and of the foot's torque.
    """

    force: Array  # generalised forces f (nf,) in the pendulum's order [N, N m]
    cop_acceleration: Array  # of the leg's foot on the ground (1,) or (2,) [m/s^2]
    phase: str = "run"  # the active part of the law in one word, such as "lean" or "catch"
    ok: bool = True  # False if the law could not meet its own goal
    note: str = ""  # why not; one line for the user, or empty


class BalanceLaw(Protocol):
    """From the pendulum's state to generalised forces. Laws keep no state of their own."""

    @property
    def model(self) -> Pendulum:
        """The law's model of the pendulum."""

    def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
        """Return the command at configuration q (nq,), velocity v (nv,) and time [s].

        Raises InvalidInputError: wrong sizes or not finite.
        """
