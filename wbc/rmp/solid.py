"""The solid reaction mass pendulum: three pairs of masses on turning rails (paper 4.1, Table 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.rmp.frames import leg_axes, leg_direction, quaternion_product, rotation_rows, turn
from wbc.rmp.lagrangian import Mechanism
from wbc.rmp.pendulum import ReactionMassPendulum
from wbc.validate import Array, finite_vector

# Closest to a singular direction of an angle, as a cosine: 1e-6 rad leaves ten digits.
SINGULAR = 1e-6
# How far a quaternion's norm may be off.
UNIT = 1e-6


@dataclass(frozen=True, eq=False)
class _SolidPendulum(ReactionMassPendulum):
    """What both descriptions of the solid pendulum share: leg, radii and checks on them."""

    def momenta(self, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """Return the angular momenta (k_G, k_P) about CoM and CoP (3,) [kg m^2/s], world axes.

        k_P is that of absolute velocities: the motion of the CoP itself is not subtracted.
        """
        k_G, k_P = self.functions["momenta"](self._checked(q), self._velocity(v))
        return k_G.full().ravel(), k_P.full().ravel()

    def inertia(self, q: ArrayLike) -> Array:
        """Return the moments of inertia (3,) about the axes of the masses [kg m^2]."""
        squares = self._checked(q)[-3:] ** 2
        return self.mass / 3.0 * (squares.sum() - squares)

    def inertia_rate(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the rate (3,) of :meth:`inertia` [kg m^2/s]."""
        products = self._checked(q)[-3:] * self._velocity(v)[-3:]
        return self.mass * 2.0 / 3.0 * (products.sum() - products)

    def _assemble(
        self, q: ca.SX, v: ca.SX, rate: ca.SX, rotation: ca.SX, w: ca.SX, spin: tuple[int, ...]
    ) -> Mechanism:
        """Return the mechanism for a rotation and its body rate w, however they are described."""
        nq = q.numel()
        coordinates = (0, 1, 2, 3, 4, nq - 3, nq - 2, nq - 1) if spin else tuple(range(nq))
        places = (0, 1, 2, 3, 4, 8, 9, 10) if spin else tuple(range(nq))
        cop = ca.vertcat(q[0], q[1], 0.0)
        leg = q[4] * leg_direction(q[2], q[3])
        com = cop + leg
        com_rate = ca.jtimes(com, q[:5], v[:5])
        squares, slide = q[nq - 3 :] ** 2, v[8:]
        inertia = self.mass / 3.0 * (ca.sum1(squares) - squares)
        k_G = rotation @ (inertia * w)
        return Mechanism(
            q=q,
            v=v,
            rate=rate,
            coordinates=coordinates,
            places=places,
            spin=spin,
            driven=2,
            com=com,
            kinetic=0.5 * self.mass * ca.sumsqr(com_rate)
            + 0.5 * ca.dot(w, inertia * w)
            + self.mass / 6.0 * ca.sumsqr(slide),
            potential=self.mass * self.gravity * com[2],
            momenta=(k_G, k_G + ca.cross(leg, self.mass * com_rate)),
        )

    def _checked(self, q: ArrayLike) -> Array:
        q = finite_vector("q", q, len(self.Q))
        if q[4] <= 0.0:
            raise InvalidInputError(f"q: r_l, the leg's length, must be positive, got {q[4]:g} m")
        if q[-3:].min() < 0.0:
            raise InvalidInputError(f"q: r_1, r_2, r_3 must not be negative, got {q[-3:]} m")
        return q

    def _require_inertia(self, q: Array) -> None:
        if abs(np.cos(q[3])) < SINGULAR:
            raise InvalidInputError(
                "q: the leg lies along the horizontal y axis, where theta is undefined (phi is"
                f" {np.degrees(q[3]):.6g} degrees)"
            )
        if np.count_nonzero(q[-3:]) < 2:
            raise InvalidInputError(
                f"q: at radii {q[-3:]} the reaction mass has no inertia about some axis, and its"
                " acceleration is undefined; two radii at least must be positive"
            )


@dataclass(frozen=True, eq=False)
class SolidRmp(_SolidPendulum):
    """Three pairs of masses M/6 at +-r_k along the axes of a turning frame, on a leg.

    The orientation is a unit quaternion and its velocity the body rate w, so no orientation of the
    mass is singular.

    =====================  ==============  ===============  ========================================
    q (12,)                v (11,)         f (9,)           meaning
    =====================  ==============  ===============  ========================================
    x_cop, y_cop           rates           (ground)         CoP on the ground [m]
    theta                  rate            tau_theta        leg, x axis to z axis [rad, N m]
    phi                    rate            tau_phi          leg, out of that plane to y [rad, N m]
    r_l                    rate            f_l              length of the leg, > 0 [m, N]
    quat_x, _y, _z, _w     w_1, w_2, w_3   tau_1 .. tau_3   frame of the masses; body axes [N m]
    r_1, r_2, r_3          rates           f_1, f_2, f_3    distance of the masses, >= 0 [m, N]
    =====================  ==============  ===============  ========================================

    Space is (x, y, z), z up. The leg points along n = (cos theta cos phi, sin phi, sin theta cos
    phi): upright at theta = pi/2, phi = 0. **The singular directions of these angles are those of
    the horizontal y axis** (phi = +-pi/2: the leg flat on the ground, sideways), where
    ``forward_dynamics`` refuses to go; there is none at or near the upright.

    f_k moves both masses of pair k. (tau_1, tau_2, tau_3) is the torque on the masses; if a hip
    between leg and masses gives it, its reaction on the leg is in ``tau_theta`` and ``tau_phi``:
    see :meth:`hip_torque`. The equations are those of (paper 4.1, where the moment of
    one pair is printed as m r_k^2, half of what it is)

        T = M/2 |c'|^2 + 1/2 w^T I w + M/6 sum r_k'^2,    I_i = M/3 (r_j^2 + r_k^2),    V = M g z
    """

    Q: ClassVar = (
        *("x_cop", "y_cop", "theta", "phi", "r_l"),
        *("quat_x", "quat_y", "quat_z", "quat_w", "r_1", "r_2", "r_3"),
    )
    V: ClassVar = (
        *("x_cop", "y_cop", "theta", "phi", "r_l"),
        *("w_1", "w_2", "w_3", "r_1", "r_2", "r_3"),
    )
    F: ClassVar = (
        *("tau_theta", "tau_phi", "f_l", "tau_1", "tau_2", "tau_3"),
        *("f_1", "f_2", "f_3"),
    )

    def hip_torque(self, q: ArrayLike, torque: ArrayLike) -> Array:
        """Return the generalised forces f (9,) of a torque between leg and masses.

        Its reaction turns the leg about the CoP, where the ground takes a moment about the vertical
        only: n . R torque / n_z, by the balance of the massless leg about itself.

        Parameters
        ----------
        torque:
            On the masses, in their axes (3,) [N m].

        Raises
        ------
        InvalidInputError
            The leg is horizontal: the ground cannot keep it from spinning.
        """
        q = self._checked(q)
        torque = finite_vector("torque", torque, 3)
        turning = np.array(rotation_rows(*q[5:9])) @ torque
        n = np.array((np.cos(q[2]) * np.cos(q[3]), np.sin(q[3]), np.sin(q[2]) * np.cos(q[3])))
        if abs(n[2]) < SINGULAR:
            raise InvalidInputError("q: the leg is horizontal; no hip can push against it")
        reaction = (n @ turning / n[2]) * np.array((0.0, 0.0, 1.0)) - turning
        f = np.zeros(9)
        f[:2] = leg_axes(q[2], q[3]).T @ reaction
        f[3:6] = torque
        return f

    def momentum_rate(self, q: ArrayLike, f: ArrayLike) -> Array:
        """Return k_G' (3,) [N m], world axes, under the generalised forces f (9,)."""
        q = self._checked(q)
        torque = finite_vector("f", f, len(self.F))[3:6]
        return np.asarray(np.array(rotation_rows(*q[5:9])) @ torque)

    def _mechanism(self) -> Mechanism:
        q, v = ca.SX.sym("q", 12), ca.SX.sym("v", 11)
        x, y, z, s = ca.vertsplit(q[5:9])
        w = v[5:8]
        quat_rate = 0.5 * quaternion_product(q[5:9], ca.vertcat(w, 0.0))
        rate = ca.vertcat(v[:5], quat_rate, v[8:])
        rotation = ca.vertcat(*(ca.horzcat(*row) for row in rotation_rows(x, y, z, s)))
        return self._assemble(q, v, rate, rotation, w, spin=(5, 6, 7))

    def _checked(self, q: ArrayLike) -> Array:
        q = super()._checked(q)
        norm = float(np.linalg.norm(q[5:9]))
        if abs(norm - 1.0) > UNIT:
            raise InvalidInputError(f"q: the quaternion's norm is {norm:.9g}; it must be 1")
        return q


@dataclass(frozen=True, eq=False)
class EulerSolidRmp(_SolidPendulum):
    """The solid pendulum in the paper's eleven coordinates (Table 1), with angles throughout.

    q = (x_cop, y_cop, theta, phi, r_l, alpha, beta, gamma, r_1, r_2, r_3), v = dq/dt, f in the
    order of q without the CoP; units, leg angles and radii as in :class:`SolidRmp`. The frame of
    the masses is turned by alpha about -y (the sense of theta), then by beta about its own x, then
    by gamma about its own z; the torques belong to these angles. alpha is measured from the world,
    not from the leg. **beta = +-pi/2 is singular**: for masses that tumble, use SolidRmp.
    """

    Q: ClassVar = (
        *("x_cop", "y_cop", "theta", "phi", "r_l"),
        *("alpha", "beta", "gamma", "r_1", "r_2", "r_3"),
    )
    V: ClassVar = Q
    F: ClassVar = (
        *("tau_theta", "tau_phi", "f_l", "tau_alpha", "tau_beta", "tau_gamma"),
        *("f_1", "f_2", "f_3"),
    )

    def _mechanism(self) -> Mechanism:
        q, v = ca.SX.sym("q", 11), ca.SX.sym("v", 11)
        turns = [turn(axis, q[5 + k]) for k, axis in enumerate((-2, 1, 3))]
        axes = (ca.DM([0.0, -1.0, 0.0]), ca.DM([1.0, 0.0, 0.0]), ca.DM([0.0, 0.0, 1.0]))
        w = axes[0] * v[5]
        w = turns[1].T @ w + axes[1] * v[6]
        w = turns[2].T @ w + axes[2] * v[7]
        return self._assemble(q, v, v, turns[0] @ turns[1] @ turns[2], w, spin=())

    def _require_inertia(self, q: Array) -> None:
        super()._require_inertia(q)
        if abs(np.cos(q[6])) < SINGULAR:
            raise InvalidInputError(
                f"q: beta = {np.degrees(q[6]):.6g} degrees is singular; SolidRmp has no such"
                " orientation"
            )
