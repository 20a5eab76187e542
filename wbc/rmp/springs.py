"""Springs along the leg and on the rails of the reaction mass: passive forces with an energy."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.errors import InvalidInputError
from wbc.rmp.pendulum import ReactionMassPendulum
from wbc.validate import Array, finite_number, finite_vector, read_only


@dataclass(frozen=True, eq=False)
class Springs:
    """Linear springs on r_l and on every r_k.

    Parameters
    ----------
    leg, masses:
        Stiffness of the leg's spring and of every mass coordinate's [N/m], not negative.
    leg_rest, masses_rest:
        Where they are slack [m]: a number for the leg; for the masses one for all (1,), or one for
        each pair of a solid pendulum (3,).

    Raises
    ------
    InvalidInputError
        A negative stiffness, or what is not a number.
    """

    leg: float
    leg_rest: float
    masses: float
    masses_rest: Array

    def __post_init__(self) -> None:
        for name in ("leg", "leg_rest", "masses"):
            value = finite_number(f"springs: {name}", getattr(self, name), least=0.0)
            object.__setattr__(self, name, value)
        size = np.size(self.masses_rest)
        rest = finite_vector("springs: masses_rest", self.masses_rest, size)
        object.__setattr__(self, "masses_rest", read_only(rest))

    def rest_of(self, model: ReactionMassPendulum) -> Array:
        """Return ``masses_rest`` for each of the model's radii, (1,) or (3,).

        Raises
        ------
        InvalidInputError
            There are neither as many nor one.
        """
        count = 1 if "r" in model.Q else 3
        if self.masses_rest.size not in (1, count):
            raise InvalidInputError(
                f"springs: masses_rest holds {self.masses_rest.size} lengths, but a"
                f" {type(model).__name__} has {count} radii"
            )
        return np.broadcast_to(self.masses_rest, (count,))

    def forces(self, model: ReactionMassPendulum, q: ca.SX) -> ca.SX:
        """Return the springs' generalised forces (nf,) at symbols or numbers q (nq,)."""
        rest = self.rest_of(model)
        f = type(q).zeros(len(model.F))
        f[model.F.index("f_l")] = -self.leg * (q[model.Q.index("r_l")] - self.leg_rest)
        for k in range(-rest.size, 0):
            f[len(model.F) + k] = -self.masses * (q[len(model.Q) + k] - rest[k])
        return f

    def energy(self, model: ReactionMassPendulum, q: Array) -> Array:
        """Return the energy stored at configurations q (..., nq) [J], one each."""
        rest = self.rest_of(model)
        leg = q[..., model.Q.index("r_l")] - self.leg_rest
        masses = q[..., -rest.size :] - rest
        stored: Array = 0.5 * self.leg * leg**2 + 0.5 * self.masses * (masses**2).sum(axis=-1)
        return stored


# No springs at all.
SLACK = Springs(0.0, 0.0, 0.0, np.zeros(1))
