"""Model errors: how the simulated robot differs from the controllers' model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.kinds import whole_number
from wbc.robot import Robot
from wbc.validate import LARGEST, Array, check_fields, finite_array, read_only, set_fields

SPREADS = ("mass_spread", "inertia_spread", "com_spread")


@dataclass(frozen=True, eq=False)
class ModelMismatch:
    """Errors of the controller's model: how the true robot in the physics differs from it.

    Attributes
    ----------
    mass:
        Factor on the mass of every link, and on its moments of inertia.
    inertia:
        Further factor on the moments of inertia of every link.
    com:
        Shift (3,) of the base link's CoM in its own axes [m].
    friction:
        Factor on the friction of the ground.
    mass_spread, inertia_spread:
        Each link's factors are multiplied by 1 + spread u, u uniform in [-1, 1]; below 1.
    com_spread:
        Each link's CoM is shifted by up to this along each of its joint's axes [m].
    seed:
        Of the random numbers; the same seed gives the same robot.
    """

    mass: float = 1.0
    inertia: float = 1.0
    com: ArrayLike = (0.0, 0.0, 0.0)
    friction: float = 1.0
    mass_spread: float = 0.0
    inertia_spread: float = 0.0
    com_spread: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_fields(self, "model mismatch, ", "mass", "inertia", above=0.0)
        check_fields(self, "model mismatch, ", "friction", *SPREADS, least=0.0)
        set_fields(self, com=read_only(finite_array("model mismatch, com", self.com, (3,))))
        for name in ("mass_spread", "inertia_spread"):
            if getattr(self, name) >= 1.0:
                raise InvalidInputError(f"model mismatch, {name}: must be below 1")
        set_fields(self, seed=seed_number("model mismatch, seed", self.seed))


def seed_number(what: str, seed: object) -> int:
    """Return a seed of NumPy's random numbers."""
    return whole_number(what, seed, most=LARGEST)


EXACT = ModelMismatch()


class PrincipalInertia(NamedTuple):
    """Mass properties of a link in its joint's frame.

    ``axes`` (3, 3) holds the principal axes as columns, ``moments`` (3,) belong to them.
    """

    mass: float
    com: Array
    axes: Array
    moments: Array


def principal_inertia(inertia: Any) -> PrincipalInertia:
    """Return the principal axes and moments of a ``pin.Inertia``."""
    moments, axes = np.linalg.eigh(np.array(inertia.inertia))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    # Negative by rounding only: Robot.load refuses others.
    return PrincipalInertia(
        float(inertia.mass), np.array(inertia.lever), axes, np.maximum(moments, 0.0)
    )


def true_inertias(robot: Robot, mismatch: ModelMismatch) -> list[PrincipalInertia]:
    """Return the mass properties of the link of each Pinocchio joint; entry 0 is no link."""
    inertias = [principal_inertia(body) for body in robot.model.inertias]
    random = np.random.default_rng(mismatch.seed).uniform(-1.0, 1.0, (len(inertias), 5))
    for j, (inertia, u) in enumerate(zip(inertias, random, strict=True)):
        mass = mismatch.mass * (1.0 + mismatch.mass_spread * u[0])
        moments = mass * mismatch.inertia * (1.0 + mismatch.inertia_spread * u[1])
        shift = mismatch.com_spread * u[2:] + (mismatch.com if j == 1 else 0.0)
        inertias[j] = PrincipalInertia(
            mass * inertia.mass, inertia.com + shift, inertia.axes, moments * inertia.moments
        )
    return inertias
