"""The planar reaction mass pendulum: a reaction wheel of variable inertia on a leg (paper 4.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rmp.pendulum import SMALLEST, Mechanism, ReactionMassPendulum
from wbc.validate import Array, check_fields, finite_vector

# Errors of a held length decay as (1 + rate t) e^(-rate t) [1/s]. The radius needs the stiffer
# hold: the centrifugal force of a wheel that gains speed grows while a command is held.
LENGTH_RATE, RADIUS_RATE = 10.0, 60.0


@dataclass(frozen=True, eq=False)
class PlanarRmp(ReactionMassPendulum):
    """Two masses M/2 at distance r either side of the CoM, on a leg from the CoP to the CoM.

    ======  ===========  ====  ============================================================
    q       force in f   unit  meaning
    ======  ===========  ====  ============================================================
    x_cop   (ground)     m     position of the CoP on the ground
    theta   tau_theta    rad   leg, from the horizontal x axis upward; pi/2 is upright
    r_l     f_l          m     length of the leg, > 0
    alpha   tau          rad   line of the masses, relative to the leg; the same sense as theta
    r       f            m     distance of each mass from the CoM, >= 0
    ======  ===========  ====  ============================================================

    v = dq/dt (5,), f = (tau_theta, f_l, tau, f) (4,) in N m and N. Space is (x, z), z up. Angles,
    torques and momenta are positive from x to z, which is about the axis -y of space.

    tau_theta is the torque about the CoP. The foot cannot give any: at a true CoP it is zero, and
    tau, which the wheel's motor takes from the leg, is all there is. The equations are those of

        T = M/2 (|c'|^2 + r'^2 + r^2 (theta' + alpha')^2),    V = M g r_l sin(theta)

    and so eqs. 20-23 of the paper. Its eq. 19 lacks the product theta' alpha' that they need.
    Where the CoP moves, tau_theta = k_P' + M g r_l cos(theta) gains the term M x_cop' z_com'.
    """

    Q: ClassVar = ("x_cop", "theta", "r_l", "alpha", "r")
    V: ClassVar = Q
    F: ClassVar = ("tau_theta", "f_l", "tau", "f")
    COP: ClassVar = 1
    LEG: ClassVar = 2
    RADII: ClassVar = 1

    def momenta(self, q: ArrayLike, v: ArrayLike) -> tuple[float, float]:
        """Return the angular momenta (k_G, k_P) about the CoM and the CoP [kg m^2/s].

        k_P is that of absolute velocities: the motion of the CoP itself is not subtracted.
        """
        k_G, k_P = self.functions["momenta"](self._checked(q), self._velocity(v))
        return float(k_G), float(k_P)

    def inertia(self, q: ArrayLike) -> float:
        """Return the moment of inertia M r^2 of the masses about the CoM [kg m^2]."""
        return float(self.mass * self._checked(q)[4] ** 2)

    def inertia_rate(self, q: ArrayLike, v: ArrayLike) -> float:
        """Return the rate 2 M r r' of :meth:`inertia` [kg m^2/s]."""
        return float(2.0 * self.mass * self._checked(q)[4] * self._velocity(v)[4])

    def momentum_rate(self, q: ArrayLike, f: ArrayLike) -> float:
        """Return k_G' [N m] under the generalised forces f: the wheel's torque (eq. 23)."""
        self._checked(q)
        return float(finite_vector("f", f, 4)[2])

    def _mechanism(self) -> Mechanism:
        q, v = ca.SX.sym("q", 5), ca.SX.sym("v", 5)
        x_cop, theta, r_l, _, r = ca.vertsplit(q)
        _, theta_rate, _, alpha_rate, r_rate = ca.vertsplit(v)
        com = ca.vertcat(x_cop + r_l * ca.cos(theta), r_l * ca.sin(theta))
        spin = theta_rate + alpha_rate
        T = 0.5 * self.mass * (ca.sumsqr(ca.jtimes(com, q, v)) + r_rate**2 + (r * spin) ** 2)
        momentum = ca.gradient(T, v)
        return Mechanism(
            q=q,
            v=v,
            rate=v,
            coordinates=list(range(5)),
            places=list(range(5)),
            spin=[],
            com=com,
            kinetic=T,
            potential=self.mass * self.gravity * com[1],
            # Turning alpha alone turns the masses about the CoM, turning theta all about the CoP.
            momenta=(momentum[3], momentum[1]),
        )

    def _require_inertia(self, q: Array) -> None:
        if abs(q[4]) < SMALLEST:
            raise InvalidInputError(
                f"q: at r = {q[4]:g} the wheel has no inertia, and its acceleration is undefined;"
                f" give it a small r of {SMALLEST:g} m or more (the leg moves as an inverted"
                " pendulum under tau_theta - tau at any r)"
            )


@dataclass(frozen=True)
class Held:
    """A planar reaction wheel pendulum: length of the leg and radius of the masses stay.

    Raises InvalidInputError: not a planar pendulum, a number that is not positive, or a ``dt`` too
    long for the hold.
    """

    model: PlanarRmp
    length: float  # of the leg [m], > 0
    radius: float  # of the wheel [m], > 0
    dt: float = 0.0  # time that forces are held for [s]; 0 in continuous time

    def __post_init__(self) -> None:
        if not isinstance(self.model, PlanarRmp):
            kind = type(self.model).__name__
            raise InvalidInputError(f"model: this law needs a PlanarRmp, got {kind}")
        check_fields(self, "", "dt", least=0.0)
        check_fields(self, "", "length", "radius", above=0.0)
        most = 1.0 / max(LENGTH_RATE, RADIUS_RATE)
        if self.dt > most:
            raise InvalidInputError(
                f"dt: {self.dt:g} s between commands is too long to hold the masses' radius; at"
                f" most {most:.3g} s"
            )

    @property
    def leg_inertia(self) -> float:
        """M r_l^2 [kg m^2], about the foot."""
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
        """Return f (4,) with that torque on the wheel and none at the foot (eqs. 20 and 21).

        Weight and centrifugal forces are those of the middle of the ``dt`` that f is held for:
        those of its beginning lag by dt/2, and a leg that gives way in step with its swing takes
        more energy than a weak torque brings.
        """
        M, g, half = self.model.mass, self.model.gravity, self.dt / 2.0
        _, theta, length, _, radius = q.tolist()
        _, theta_rate, length_rate, alpha_rate, radius_rate = v.tolist()
        torque = wheel_torque + M * length * (g * math.cos(theta) + 2.0 * length_rate * theta_rate)
        spin = theta_rate + alpha_rate
        spin += half * (wheel_torque / (M * radius**2) - 2.0 * radius_rate / radius * spin)
        theta += half * theta_rate
        theta_rate -= half * torque / (M * length**2)
        leg = _restoring_acceleration(length - self.length, length_rate, LENGTH_RATE)
        masses = _restoring_acceleration(radius - self.radius, radius_rate, RADIUS_RATE)
        f_l = M * (leg - length * theta_rate**2 + g * math.sin(theta))
        f = M * (masses - radius * spin**2)
        return np.array((0.0, f_l, wheel_torque, f))


def _restoring_acceleration(error: float, rate: float, decay: float) -> float:
    return -decay * (2.0 * rate + decay * error)
