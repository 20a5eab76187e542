"""What the planar and the solid reaction mass pendulum have in common: numbers in, numbers out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rmp.lagrangian import Mechanism, functions
from wbc.validate import Array, finite_number, finite_vector

# How far a holding force may be off, as a fraction of the weight (times the leg, for a torque).
AT_REST = 1e-8


@dataclass(frozen=True, eq=False)
class ReactionMassPendulum(ABC):
    """A reaction mass on a massless leg of variable length, its foot at the CoP.

    Parameters
    ----------
    mass:
        All of the mass M [kg].
    gravity:
        [m/s^2], along the last axis of space, downward.

    Attributes
    ----------
    functions:
        The CasADi Functions behind the methods, by the methods' names, for planners; see
        :func:`wbc.rmp.lagrangian.functions`. They check nothing.

    Raises
    ------
    InvalidInputError
        A mass that is not positive, negative gravity, not a number. Every method raises it too,
        for arguments of wrong size or not finite and configurations that no pendulum can have.
    """

    mass: float
    gravity: float = 9.81
    functions: Mapping[str, ca.Function] = field(init=False, repr=False)

    Q: ClassVar[tuple[str, ...]]
    V: ClassVar[tuple[str, ...]]
    F: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        name = type(self).__name__
        object.__setattr__(self, "mass", finite_number(f"{name}: mass", self.mass, above=0.0))
        gravity = finite_number(f"{name}: gravity", self.gravity, least=0.0)
        object.__setattr__(self, "gravity", gravity)
        built = functions(self._mechanism(), self.mass, gravity)
        object.__setattr__(self, "functions", MappingProxyType(built))

    @abstractmethod
    def _mechanism(self) -> Mechanism:
        """Return the energies."""

    @abstractmethod
    def _checked(self, q: ArrayLike) -> Array:
        """Return q as an array (nq,) after all checks."""

    @abstractmethod
    def _require_inertia(self, q: Array) -> None:
        """Raise unless every force has an inertia to accelerate."""

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return M(q) (nv, nv), singular by as many directions as the CoP has coordinates."""
        return self._call("mass_matrix", self._checked(q))

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return b(q, v) (nv,): Coriolis, centrifugal and gravity terms, so that M a + b = f."""
        return self._call("bias", self._checked(q), self._velocity(v)).ravel()

    def forward_dynamics(
        self, q: ArrayLike, v: ArrayLike, f: ArrayLike, cop_acceleration: ArrayLike | None = None
    ) -> Array:
        """Return the acceleration a (nv,) under the generalised forces f (nf,).

        The CoP has no mass of its own: its acceleration is an input, zero unless given, and comes
        back as the first entries of a.
        """
        q = self._checked(q)
        self._require_inertia(q)
        size = len(self.V) - len(self.F)
        if cop_acceleration is None:
            cop_acceleration = np.zeros(size)
        w = finite_vector("cop_acceleration", np.atleast_1d(cop_acceleration), size)
        f = finite_vector("f", f, len(self.F))
        return self._call("forward_dynamics", q, self._velocity(v), f, w).ravel()

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return the generalised forces f (nf,) under which the acceleration is a (nv,)."""
        a = finite_vector("a", a, len(self.V))
        return self._call("inverse_dynamics", self._checked(q), self._velocity(v), a).ravel()

    def ground_reaction(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return the force f_r = M (c'' - g) of the ground on the foot [N], up last."""
        a = finite_vector("a", a, len(self.V))
        return self._call("ground_reaction", self._checked(q), self._velocity(v), a).ravel()

    def energies(self, q: ArrayLike, v: ArrayLike) -> tuple[float, float]:
        """Return kinetic and potential energy (T, V) [J]; V is zero at the height of the CoP."""
        T, V = self.functions["energies"](self._checked(q), self._velocity(v))
        return float(T), float(V)

    def com(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """Return position [m] and velocity [m/s] of the CoM, up last."""
        c, rate = self.functions["com"](self._checked(q), self._velocity(v))
        return c.full().ravel(), rate.full().ravel()

    def holding_force(self, q: ArrayLike) -> Array:
        """Return the generalised forces f (nf,) that keep the pendulum at rest at q."""
        still = np.zeros(len(self.V))
        return self.inverse_dynamics(q, still, still)

    def linearisation(self, q0: ArrayLike, f0: ArrayLike) -> tuple[Array, Array]:
        """Return (A, B) of x' = A x + B u about rest at q0 under the forces f0.

        x = (dq, v), both in the order of v (2 nv,); u = (CoP acceleration, f - f0) (nv,). Where v
        holds body rates, the matching entries of dq are a small rotation in body axes.

        Raises
        ------
        InvalidInputError
            (q0, f0) is no equilibrium; the message says what is missing.
        """
        q0, f0 = self._checked(q0), finite_vector("f0", f0, len(self.F))
        self._require_inertia(q0)
        missing = self.holding_force(q0) - f0
        leg = float(q0[self.Q.index("r_l")])
        if np.abs(missing).max() > AT_REST * max(self.mass * self.gravity, 1.0) * max(leg, 1.0):
            listed = ", ".join(
                f"{name} {value:+.4g}" for name, value in zip(self.F, missing, strict=True)
            )
            raise InvalidInputError(
                f"linearisation: no equilibrium; f0 lacks {listed} (N or N m); holding_force(q0)"
                " returns the forces that hold q0"
            )
        nv = len(self.V)
        u = np.concatenate((np.zeros(nv - len(self.F)), f0))
        a_q, a_u = self.functions["acceleration_rates"](q0, np.zeros(nv), u)
        A, B = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, nv))
        # At rest every force that is a product of velocities has no slope: da/dv = 0.
        A[:nv, nv:] = np.eye(nv)
        A[nv:, :nv] = a_q.full()
        B[nv:] = a_u.full()
        return A, B

    def _velocity(self, v: ArrayLike) -> Array:
        return finite_vector("v", v, len(self.V))

    def _call(self, name: str, *arguments: Array) -> Array:
        result: Array = self.functions[name](*arguments).full()
        return result
