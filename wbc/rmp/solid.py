"""The solid reaction mass pendulum: three pairs of masses on turning rails (paper 4.1, Table 1).

At the end are the directions and rotations that it is made of, most for numbers and for symbols.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.placement import from_quaternion, turn_about
from wbc.rmp.pendulum import SMALLEST, Mechanism, ReactionMassPendulum
from wbc.rotations import rotation_from
from wbc.validate import Array, finite_vector

# Closest to a singular direction of an angle, as a cosine: 1e-6 rad leaves ten digits.
SINGULAR = 1e-6
# How far a quaternion's norm may be off.
UNIT = 1e-6
# Below this sine of half the angle, squared, a series of two terms is exact to rounding.
_SMALL = 1e-7
_LEG, _LEG_FORCES = ("x_cop", "y_cop", "theta", "phi", "r_l"), ("tau_theta", "tau_phi", "f_l")
_RADII, _RADII_FORCES = ("r_1", "r_2", "r_3"), ("f_1", "f_2", "f_3")


@dataclass(frozen=True, eq=False)
class _SolidPendulum(ReactionMassPendulum):
    """What both descriptions of the solid pendulum share: leg, radii and checks on them."""

    COP: ClassVar = 2
    LEG: ClassVar = 4
    RADII: ClassVar = 3

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
        self, q: ca.SX, v: ca.SX, rate: ca.SX, R: ca.SX, w: ca.SX, spin: list[int]
    ) -> Mechanism:
        """Return the mechanism for a rotation R and its body rate w, however they are described."""
        nq = q.numel()
        leg = q[4] * leg_direction(q[2], q[3])
        com = ca.vertcat(q[0], q[1], 0.0) + leg
        com_rate = ca.jtimes(com, q[:5], v[:5])
        squares, slide = q[nq - 3 :] ** 2, v[8:]
        inertia = self.mass / 3.0 * (ca.sum1(squares) - squares)
        k_G = R @ (inertia * w)
        return Mechanism(
            q=q,
            v=v,
            rate=rate,
            coordinates=[*range(5), nq - 3, nq - 2, nq - 1] if spin else list(range(nq)),
            places=[*range(5), 8, 9, 10] if spin else list(range(nq)),
            spin=spin,
            com=com,
            kinetic=0.5 * self.mass * ca.sumsqr(com_rate)
            + 0.5 * ca.dot(w, inertia * w)
            + self.mass / 6.0 * ca.sumsqr(slide),
            potential=self.mass * self.gravity * com[2],
            momenta=(k_G, k_G + ca.cross(leg, self.mass * com_rate)),
        )

    def _require_inertia(self, q: Array) -> None:
        if abs(np.cos(q[3])) < SINGULAR:
            raise InvalidInputError(
                "q: the leg lies along the horizontal y axis, where theta is undefined (phi is"
                f" {np.degrees(q[3]):.6g} degrees)"
            )
        if np.count_nonzero(np.abs(q[-3:]) >= SMALLEST) < 2:
            raise InvalidInputError(
                f"q: at radii {q[-3:]} the reaction mass has no inertia about some axis, and its"
                f" acceleration is undefined; two radii at least must be {SMALLEST:g} m or more"
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

    Q: ClassVar = (*_LEG, "quat_x", "quat_y", "quat_z", "quat_w", *_RADII)
    V: ClassVar = (*_LEG, "w_1", "w_2", "w_3", *_RADII)
    F: ClassVar = (*_LEG_FORCES, "tau_1", "tau_2", "tau_3", *_RADII_FORCES)

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
        turning = rotation_from(q[5:9]) @ torque
        n, axes = leg_axes(q[2], q[3])
        if abs(n[2]) < SINGULAR:
            raise InvalidInputError("q: the leg is horizontal; no hip can push against it")
        reaction = np.array((0.0, 0.0, n @ turning / n[2])) - turning
        f = np.zeros(9)
        f[:2] = axes.T @ reaction
        f[3:6] = torque
        return f

    def momentum_rate(self, q: ArrayLike, f: ArrayLike) -> Array:
        """Return k_G' (3,) [N m], world axes, under the generalised forces f (9,)."""
        q = self._checked(q)
        torque = finite_vector("f", f, len(self.F))[3:6]
        return np.asarray(rotation_from(q[5:9]) @ torque)

    def _mechanism(self) -> Mechanism:
        q, v = ca.SX.sym("q", 12), ca.SX.sym("v", 11)
        rate = ca.vertcat(v[:5], quaternion_rate(q[5:9], v[5:8]), v[8:])
        return self._assemble(q, v, rate, from_quaternion(q[5:9]), v[5:8], spin=[5, 6, 7])

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

    Q: ClassVar = (*_LEG, "alpha", "beta", "gamma", *_RADII)
    V: ClassVar = Q
    F: ClassVar = (*_LEG_FORCES, "tau_alpha", "tau_beta", "tau_gamma", *_RADII_FORCES)

    def _mechanism(self) -> Mechanism:
        q, v = ca.SX.sym("q", 11), ca.SX.sym("v", 11)
        axes = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        rotations = [
            turn_about(axis, ca.cos(q[5 + k]), ca.sin(q[5 + k])) for k, axis in enumerate(axes)
        ]
        w = axes[0] * v[5]
        w = rotations[1].T @ w + axes[1] * v[6]
        w = rotations[2].T @ w + axes[2] * v[7]
        return self._assemble(q, v, v, rotations[0] @ rotations[1] @ rotations[2], w, spin=[])

    def _require_inertia(self, q: Array) -> None:
        super()._require_inertia(q)
        if abs(np.cos(q[6])) < SINGULAR:
            raise InvalidInputError(
                f"q: beta = {np.degrees(q[6]):.6g} degrees is singular; SolidRmp has no such"
                " orientation"
            )


# ------------------------------------------------------------------ directions and rotations


def leg_direction(theta: ca.SX, phi: ca.SX) -> ca.SX:
    """Return the unit vector n (3,) from the CoP to the CoM.

    theta turns it from the x axis to the z axis, phi out of that plane toward y. Its singular
    directions are +-y: there theta is undefined.
    """
    return ca.vertcat(ca.cos(theta) * ca.cos(phi), ca.sin(phi), ca.sin(theta) * ca.cos(phi))


def leg_axes(theta: float, phi: float) -> tuple[Array, Array]:
    """Return n (3,), and the leg's angular velocities (3, 2) per unit of theta' and of phi'.

    They are n x dn/dtheta and n x dn/dphi in world axes: the leg does not spin about itself.
    """
    ct, st, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    n = np.array((ct * cp, sp, st * cp))
    by_theta = np.array((-st * cp, 0.0, ct * cp))
    by_phi = np.array((-ct * sp, cp, -st * sp))
    return n, np.column_stack((np.cross(n, by_theta), np.cross(n, by_phi)))


def quaternion_product(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the quaternion (4,) of rotation a after rotation b, both x y z w."""
    vector = a[3] * b[:3] + b[3] * a[:3] + ca.cross(a[:3], b[:3])
    return ca.vertcat(vector, a[3] * b[3] - ca.dot(a[:3], b[:3]))


def rotation_vector(quaternion: ca.SX) -> ca.SX:
    """Return the rotation vector (3,) [rad] of a unit quaternion x y z w, by the shorter way.

    The wheel's angle of a solid pendulum, as :class:`~wbc.rmp.balance.law.LawBounds` limits it.
    """
    # One orientation, two quaternions: the one with the positive scalar part is the shorter way.
    q = ca.if_else(quaternion[3] < 0.0, -1.0, 1.0) * quaternion
    square = ca.sumsqr(q[:3])
    size = ca.sqrt(ca.fmax(square, _SMALL))
    # angle / sine of half of it; the series in the square of that sine has slopes at zero too.
    ratio = ca.if_else(square > _SMALL, 2.0 * ca.atan2(size, q[3]) / size, 2.0 + square / 3.0)
    return ratio * q[:3]


def quaternion_rate(quaternion: ca.SX, rate: ca.SX) -> ca.SX:
    """Return the rate (4,) of a unit quaternion that turns at the body rate (3,)."""
    return 0.5 * quaternion_product(quaternion, ca.vertcat(rate, 0.0))
