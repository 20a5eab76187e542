"""Boundary states of a plan: any components of the pendulum's state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from wbc.errors import InvalidInputError
from wbc.validate import Array, finite_number, finite_vector

Components = Sequence[float | None]
# Names of a plan's states, each with three components; the orientation's are Rodrigues parameters.
STATE = ("com", "com_velocity", "orientation", "momentum", "radii", "radii_rates")
# How far a principal moment may exceed the sum of the others by rounding, as a fraction.
ROUNDING = 1e-9
FULL_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class State:
    """Components of a state of the solid pendulum; None, for all or one of three, leaves it free.

    Parameters
    ----------
    com, com_velocity:
        c [m] and c' [m/s].
    rotation:
        Orientation of the masses as a rotation vector [rad] from the problem's ``reference``.
        Its length tells turns apart and must be below 2 pi. Either all three components, or zeros
        with others left free: (0, 0, None) is any turn about z.
    momentum:
        Angular momentum about the CoM, k_G [kg m^2/s], world axes.
    radii, radii_rates:
        r [m] and r' [m/s].
    inertia:
        Principal moments of inertia about the masses' axes [kg m^2], all three, in place of radii.

    Raises
    ------
    InvalidInputError
        Not three numbers or None, not finite, a turn too long, radii that are not positive, or
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
                object.__setattr__(self, each.name, _components(each.name, value))
        self._check_rotation()
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

    def _check_rotation(self) -> None:
        if self.rotation is None:
            return
        if None in self.rotation:
            if any(self.rotation):
                raise InvalidInputError(
                    "state: rotation needs all three components, or zeros where others are free"
                )
            return
        turn = float(np.linalg.norm(np.array(self.rotation, dtype=float)))
        if turn >= FULL_TURN:
            raise InvalidInputError(
                f"state: a rotation of {turn:.4g} rad from the reference reaches a full turn, where"
                " the orientation's parameters are singular; put the problem's reference in the"
                " middle of the turn, so that it runs from -turn/2 to turn/2"
            )


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
    moments = finite_vector("inertia", np.array(inertia, dtype=float), 3)
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


def _components(name: str, value: Components) -> tuple[float | None, ...]:
    if isinstance(value, str) or np.shape(np.array(value, dtype=object)) != (3,):
        raise InvalidInputError(f"state: {name} must be three numbers (or null), got {value!r}")
    return tuple(None if x is None else finite_number(f"state: {name}", x) for x in value)
