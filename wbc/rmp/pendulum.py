"""The base of the planar and the solid reaction mass pendulum: equations of motion, and methods.

For velocities v that are the rates of coordinates, with p = dT/dv, Lagrange's equations are

    M(q) a + b(q, v) = f,    M = dp/dv,    b = (dp/dq) q' - dT/dq + dV/dq

Three velocities may be body rates w of a rotation that the energies do not depend on. Their rows
are Euler's: b gains w x dT/dw (Boltzmann and Hamel's form of the same principle).

The first coordinates of a reaction mass pendulum are those of its CoP. Moving the CoP while the CoM
stays takes no kinetic energy, so M is singular: the acceleration of the CoP cannot follow from
forces, but is an input. Its rows of M a + b are the horizontal ground reaction (paper, Table 1).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import ClassVar, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.spatial import STANDARD_GRAVITY
from wbc.validate import Array, check_fields, finite_vector, real_array, set_fields

# Tolerance of an equilibrium's force, as a fraction of the weight (times the leg, for a torque).
AT_REST = 1e-8
# Masses nearer to the CoM than this have no inertia [m].
SMALLEST = 1e-9


@dataclass(frozen=True, eq=False)
class Mechanism:
    """The symbolic quantities from which a pendulum's equations of motion are derived."""

    q: ca.SX  # (nq,)
    v: ca.SX  # (nv,)
    rate: ca.SX  # dq/dt (nq,), in terms of q and v
    coordinates: list[int]  # entries of q that the energies may depend on
    places: list[int]  # entries of v that are the rates of these
    spin: list[int]  # entries of v that are body rates; none, or three
    com: ca.SX  # position of the CoM, up last
    kinetic: ca.SX  # T [J]
    potential: ca.SX  # V [J]
    momenta: tuple[ca.SX, ca.SX]  # k_G, k_P [kg m^2/s]


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
        :func:`equations`. They check nothing.

    Raises
    ------
    InvalidInputError
        A mass that is not positive, negative gravity, not a number. Every method raises it too,
        for arguments of wrong size or not finite and configurations that no pendulum can have.
    """

    mass: float
    gravity: float = STANDARD_GRAVITY
    functions: Mapping[str, ca.Function] = field(init=False, repr=False)

    Q: ClassVar[tuple[str, ...]]
    V: ClassVar[tuple[str, ...]]
    F: ClassVar[tuple[str, ...]]
    COP: ClassVar[int]  # coordinates of the CoP, the first of q and v
    LEG: ClassVar[int]  # place of r_l in q
    RADII: ClassVar[int]  # radii of masses, the last of q, v and f

    def __post_init__(self) -> None:
        check_fields(self, f"{type(self).__name__}: ", "mass", above=0.0)
        check_fields(self, f"{type(self).__name__}: ", "gravity", least=0.0)
        built = equations(self._mechanism(), self.COP, self.mass, self.gravity)
        set_fields(self, functions=MappingProxyType(built))

    def __reduce__(self) -> tuple[type[Self], tuple[float, ...]]:
        """Copy and pickle what it is made of: its functions are built again."""
        return type(self), tuple(getattr(self, one.name) for one in fields(self) if one.init)

    @abstractmethod
    def _mechanism(self) -> Mechanism:
        """Return the energies."""

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
        if cop_acceleration is None:
            cop_acceleration = np.zeros(self.COP)
        w = real_array("cop_acceleration", cop_acceleration)
        w = finite_vector("cop_acceleration", np.atleast_1d(w), self.COP)
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
        largest = AT_REST * max(self.mass * self.gravity, 1.0) * max(q0[self.LEG], 1.0)
        if np.abs(missing).max() > largest:
            listed = ", ".join(
                f"{name} {value:+.4g}" for name, value in zip(self.F, missing, strict=True)
            )
            raise InvalidInputError(
                f"linearisation: no equilibrium; f0 lacks {listed} (N or N m); holding_force(q0)"
                " returns the forces that hold q0"
            )
        nv = len(self.V)
        u = np.concatenate((np.zeros(self.COP), f0))
        a_q, a_u = self.functions["acceleration_rates"](q0, np.zeros(nv), u)
        A, B = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, nv))
        # At rest every force that is a product of velocities has no slope: da/dv = 0.
        A[:nv, nv:] = np.eye(nv)
        A[nv:, :nv] = a_q.full()
        B[nv:] = a_u.full()
        return A, B

    def _checked(self, q: ArrayLike) -> Array:
        """Return q as an array (nq,) after all checks."""
        q = finite_vector("q", q, len(self.Q))
        if q[self.LEG] <= 0.0:
            length = q[self.LEG]
            raise InvalidInputError(f"q: r_l, the leg's length, must be positive, got {length:g} m")
        if q[-self.RADII :].min() < 0.0:
            names = ", ".join(self.Q[-self.RADII :])
            values = ", ".join(f"{r:g}" for r in q[-self.RADII :])
            raise InvalidInputError(f"q: {names} must not be negative, got {values} m")
        return q

    def _velocity(self, v: ArrayLike) -> Array:
        return finite_vector("v", v, len(self.V))

    def _call(self, name: str, *arguments: Array) -> Array:
        return np.asarray(self.functions[name](*arguments).full())


def equations(
    mechanism: Mechanism, driven: int, mass: float, gravity: float
) -> dict[str, ca.Function]:
    """Return the Functions of a pendulum by name; arguments and results are columns.

    ``driven`` is the number of velocities of the CoP, the first of v.

    =====================  =================================  ============================
    name                   arguments                          results
    =====================  =================================  ============================
    ``mass_matrix``        q                                  M (nv, nv)
    ``bias``               q, v                               b (nv,)
    ``inverse_dynamics``   q, v, a                            f (nv - driven,)
    ``forward_dynamics``   q, v, f, cop_acceleration          a (nv,)
    ``ground_reaction``    q, v, a                            M_total (c'' - g)
    ``energies``           q, v                               T, V
    ``momenta``            q, v                               k_G, k_P
    ``com``                q, v                               c, c'
    ``state_rate``         x = (q, v), u = (cop_acc., f)      (q', a)
    ``acceleration_rates`` q, v, u                            da/dq (nv, nv), da/du
    =====================  =================================  ============================

    The columns of ``da/dq`` are in the order of v; those of a rotation are zero, because torques
    are given in the axes that turn with it.
    """
    q, v, com = mechanism.q, mechanism.v, mechanism.com
    nv = v.numel()
    a, f, w = ca.SX.sym("a", nv), ca.SX.sym("f", nv - driven), ca.SX.sym("w", driven)
    u = ca.vertcat(w, f)
    M, b = _mass_matrix_and_bias(mechanism)
    # All rows but those of the CoP. LDL^T is square-root free and sparse: the blocks of leg,
    # rotation and radii do not couple.
    D, LT, order = ca.ldl(M[driven:, driven:])
    rest = f - b[driven:] - M[driven:, :driven] @ w
    forward = ca.vertcat(w, ca.ldl_solve(rest, D, LT, order))
    x, x_rate = q[mechanism.coordinates], v[mechanism.places]
    velocity = ca.jtimes(com, x, x_rate)
    reaction = mass * (ca.jtimes(velocity, x, x_rate) + ca.jtimes(velocity, v, a))
    reaction[-1] += mass * gravity
    spread = ca.DM.zeros(len(mechanism.places), nv)
    for row, place in enumerate(mechanism.places):
        spread[row, place] = 1.0
    a_q = ca.jacobian(forward, x) @ spread
    k_G, k_P = mechanism.momenta
    at = {"q": q, "v": v}
    table = {
        "mass_matrix": ({"q": q}, {"M": M}),
        "bias": (at, {"b": b}),
        "inverse_dynamics": (at | {"a": a}, {"f": (M @ a + b)[driven:]}),
        "forward_dynamics": (at | {"f": f, "cop_acceleration": w}, {"a": forward}),
        "ground_reaction": (at | {"a": a}, {"f_r": reaction}),
        "energies": (at, {"T": mechanism.kinetic, "V": mechanism.potential}),
        "momenta": (at, {"k_G": k_G, "k_P": k_P}),
        "com": (at, {"c": com, "c_rate": velocity}),
        "state_rate": (
            {"x": ca.vertcat(q, v), "u": u},
            {"x_rate": ca.vertcat(mechanism.rate, forward)},
        ),
        "acceleration_rates": (at | {"u": u}, {"a_q": a_q, "a_u": ca.jacobian(forward, u)}),
    }
    return {
        name: ca.Function(
            name, list(ins.values()), [ca.densify(x) for x in outs.values()], list(ins), list(outs)
        )
        for name, (ins, outs) in table.items()
    }


def _mass_matrix_and_bias(mechanism: Mechanism) -> tuple[ca.SX, ca.SX]:
    """Return M (nv, nv) and b (nv,), so that M a + b = f."""
    v, places, spin = mechanism.v, mechanism.places, mechanism.spin
    x, p = mechanism.q[mechanism.coordinates], ca.gradient(mechanism.kinetic, v)
    bias = ca.jtimes(p, x, v[places])
    bias[places] += ca.gradient(mechanism.potential - mechanism.kinetic, x)
    if spin:
        bias[spin] += ca.cross(v[spin], p[spin])
    # The one triangle for both: symmetric to the last bit.
    return ca.triu2symm(ca.triu(ca.jacobian(p, v))), bias
