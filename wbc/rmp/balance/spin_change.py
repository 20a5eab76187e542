"""Spin changed by drawing the masses in or out, at constant angular momentum: a skater's turn."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.minimum_jerk import minimum_jerk, minimum_jerk_rates
from wbc.rmp.balance.foot import SupportFoot
from wbc.rmp.balance.law import LawBounds, Pendulum, PendulumCommand, check_law, refuse_torsion
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array, check_fields, finite_vector, read_only, set_fields

# How far, as a part of it, a solid body's spin may be off one of the axes of the masses.
AXIS_TOLERANCE = 1e-6
# Least spin, as a part of that at the start: radii a million times as large are no pendulum's.
LEAST_SPIN = 1e-12


@dataclass(frozen=True, eq=False)
class SpinChange:
    """Brings the spin of the masses to ``spin`` by their radii alone, then holds it.

    No torque acts on the masses, so k_G = I w stays; so does an axis that they spin about if it is
    one of their own. The inertia for the wanted spin is I = k_G / spin:

        planar: M r^2,    solid, about axis i: (M/3) (r_j^2 + r_k^2)

    From r_0 to r_1 the radii follow the polynomial of fifth order that starts and ends at rest
    (least jerk). Forces are those of eq. 21, and of theory section 6 for the solid pendulum,

        f = M (r'' - r w^2),    f_k = M/3 (r_k'' - r_k (w_i^2 + w_j^2)),
        r'' = r''_d - 2 a e' - a^2 e,    e = r - r_d

    with a = ``rate``. Between rest and rest their work is the change of k_G w / 2.

    The leg stays where it was: its length by computed force, its direction by the foot's torque as
    far as the polygon goes. On a foot without extent (``bounds.polygon`` None) nothing holds its
    direction, so it must be balanced already, or free of gravity.

    **A solid body's middle axis.** Spin about the axis of neither the least nor the greatest
    inertia is unstable: errors grow as fast as the body turns. ``stable`` says whether it is
    another one.

    Raises InvalidInputError: a spin out of reach of the radii (the message names the range), of the
    other sign, or about no axis of the masses; masses that slide at the start, or are out of
    bounds; numbers that are unusable.
    """

    model: Pendulum
    q0: Array  # state at time 0
    v0: Array  # a solid pendulum's body rate must be along one axis of the masses
    spin: float  # wanted rate of the masses in space [rad/s], of the sign that it has
    duration: float  # of the change [s], > 0
    bounds: LawBounds = field(
        default_factory=LawBounds
    )  # radius, polygon and leg_force are respected
    rate: float = 20.0  # a, at which errors of radii, leg and lean decay [1/s]
    radii: tuple[Array, Array] = field(init=False)  # r_0 and r_1, (1,) or (3,) each [m]
    axis: int = field(init=False)  # of the masses, that they spin about; 0 for a planar pendulum
    _foot: SupportFoot | None = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_law(self, self.bounds, PlanarRmp, SolidRmp)
        refuse_torsion(self.bounds, self)
        model = self.model
        q0 = read_only(finite_vector("q0", self.q0, len(model.Q)))
        v0 = read_only(finite_vector("v0", self.v0, len(model.V)))
        check_fields(self, "", "spin")
        check_fields(self, "", "duration", "rate", above=0.0)
        low, high = reachable_spins(model, q0, v0, self.bounds)
        if not low <= self.spin <= high:
            raise InvalidInputError(
                f"spin: {self.spin:g} rad/s is out of reach; with radii in"
                f" [{self.bounds.radius[0]:g}, {self.bounds.radius[1]:g}] m this momentum gives"
                f" {low:.6g} to {high:.6g} rad/s"
            )
        start = _resting_radii(q0, v0, model.RADII, self.bounds)
        axis, spin0 = _spin(model, v0)
        if abs(self.spin) < LEAST_SPIN * abs(spin0):
            raise InvalidInputError(
                f"spin: {self.spin:g} rad/s would take masses that are infinitely far out"
            )
        end = _final_radii(start, axis, spin0 / self.spin, self.bounds)
        foot = None if self.bounds.polygon is None else SupportFoot(model, self.bounds)
        radii = (read_only(start), read_only(end))
        set_fields(self, q0=q0, v0=v0, axis=axis, radii=radii, _foot=foot)

    @property
    def stable(self) -> bool:
        """Whether, all the way, the spin is not about the axis of the middle inertia."""
        if isinstance(self.model, PlanarRmp):
            return True
        orders = []
        for radii in self.radii:
            squares = radii**2
            # I_j > I_i if r_i > r_j; equal ones are not below or above, and count as unstable.
            others = np.delete(squares, self.axis) - squares[self.axis]
            orders.append(tuple(np.sign(others).tolist()))
        return orders[0] == orders[1] and orders[0] in ((1.0, 1.0), (-1.0, -1.0))

    def reference(self, time: float) -> tuple[Array, Array, Array]:
        """Return the radii wanted at a time [s], their rates and accelerations."""
        s = min(max(time / self.duration, 0.0), 1.0)
        start, change = self.radii[0], self.radii[1] - self.radii[0]
        first, second = minimum_jerk_rates(s)
        rate, acceleration = first / self.duration, second / self.duration**2
        return start + minimum_jerk(s) * change, rate * change, acceleration * change

    def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
        """Return the forces at a time since the state that the law was made for."""
        model, masses, driven, a = self.model, self.model.RADII, self.model.COP, self.rate
        q, v = finite_vector("q", q, len(model.Q)), finite_vector("v", v, len(model.V))
        r, r_rate, r_acceleration = self.reference(time)
        wanted = np.zeros(len(model.V))
        e, e_rate = q[-masses:] - r, v[-masses:] - r_rate
        wanted[-masses:] = r_acceleration - 2.0 * a * e_rate - a**2 * e
        leg = slice(driven, 2 * driven + 1)
        wanted[leg] = -2.0 * a * v[leg] - a**2 * (q[leg] - self.q0[leg])
        force = model.inverse_dynamics(q, v, wanted)
        if masses == 1:
            # The planar tau_theta turns leg and masses; without a torque on them, the leg only.
            force[0] -= force[2]
        force[-2 * masses : -masses] = 0.0
        force[driven] = np.clip(force[driven], *self.bounds.leg_force)
        lean = np.zeros(len(force))
        lean[:driven] = force[:driven]
        force[:driven] = 0.0
        note = ""
        if self._foot is not None:
            scale, _ = self._foot.torque_scale(q, v, force, lean)
            force += scale * lean
            if scale < 1.0:
                note = "the foot is too short to hold the leg"
        phase = "change" if time < self.duration else "hold"
        return PendulumCommand(force, np.zeros(driven), phase, not note, note)


def reachable_spins(
    model: Pendulum, q0: ArrayLike, v0: ArrayLike, bounds: LawBounds
) -> tuple[float, float]:
    """Return the (least, greatest) spin [rad/s] that the radii can give at this momentum.

    Raises InvalidInputError: no spin, or about no axis of the masses, or an unusable state.
    """
    q0 = finite_vector("q0", q0, len(model.Q))
    v0 = finite_vector("v0", v0, len(model.V))
    inertia = np.atleast_1d(model.inertia(q0))
    axis, spin = _spin(model, v0)
    momentum = spin * float(inertia[axis])
    factor = model.mass if isinstance(model, PlanarRmp) else 2.0 * model.mass / 3.0
    near, far = bounds.radius
    ends = (momentum / (factor * far**2), momentum / (factor * near**2))
    return min(ends), max(ends)


def _resting_radii(q0: Array, v0: Array, count: int, bounds: LawBounds) -> Array:
    radii, (low, high) = q0[-count:].copy(), bounds.radius
    if np.abs(v0[-count:]).max() > 0.0:
        raise InvalidInputError("v0: the masses must not slide at the start")
    if radii.min() < low or radii.max() > high:
        raise InvalidInputError(f"q0: radii {radii} m are out of bounds, [{low:g}, {high:g}] m")
    return radii


def _spin(model: Pendulum, v: Array) -> tuple[int, float]:
    """Return which axis of the masses they spin about, and the rate; a planar one has axis 0."""
    if isinstance(model, PlanarRmp):
        axis, spin = 0, float(v[1] + v[3])
    else:
        w = v[5:8]
        axis = int(np.abs(w).argmax())
        spin = float(w[axis])
        off = float(np.linalg.norm(np.delete(w, axis)))
        if off > AXIS_TOLERANCE * abs(spin):
            raise InvalidInputError(
                f"v0: the body rate {w} is off the masses' axis {axis + 1} by {off:.3g} rad/s; it"
                " would tumble, and no radii give it one spin"
            )
    if spin == 0.0:
        raise InvalidInputError("v0: the masses do not spin; radii cannot change that")
    return axis, spin


def _final_radii(start: Array, axis: int, growth: float, bounds: LawBounds) -> Array:
    """Return radii with ``growth`` times the inertia about the axis.

    Those of both pairs across it grow alike, unless one of them comes to its end.
    """
    if len(start) == 1:
        return np.asarray(start * math.sqrt(growth))
    squares, (low, high) = start**2, (bounds.radius[0] ** 2, bounds.radius[1] ** 2)
    first, second = (k for k in range(3) if k != axis)
    total = growth * (squares[first] + squares[second])
    one = min(max(growth * squares[first], low), high)
    other = min(max(total - one, low), high)
    squares[first], squares[second] = total - other, other
    return np.asarray(np.sqrt(squares))
