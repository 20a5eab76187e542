"""A robot at one measured state, in motion: its dynamics and its drifts.

A drift is the velocity-dependent part of a second derivative: its value at zero acceleration of v.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from wbc.robot.kernel import NativeMotion
from wbc.robot.names import COM, WORLD
from wbc.robot.parallel_axis import (
    is_com,
    moving_frame,
    parallel_axis_curvature,
    parallel_axis_rates,
)
from wbc.robot.state import KinematicState, lazy
from wbc.spatial import skew, vech, vech_inverse
from wbc.validate import Array, read_only


class MovingState(KinematicState):
    """A kinematic state with dynamics and drifts; see :class:`wbc.Snapshot`."""

    # ------------------------------------------------------------------ dynamics

    @lazy
    def mass_matrix(self) -> Array:
        """Joint-space mass matrix M (nv, nv), the joints' rotor inertia included."""
        return self.native_motion.part("mass_matrix", self.robot.nv, -1)

    @lazy
    def bias(self) -> Array:
        """Coriolis, centrifugal and gravity forces (nv,): ``M a + bias == tau + J' f``.

        ``tau`` is the torque at the links: the motors' minus the joints' damping and dry friction
        (``robot.damping``, ``robot.friction``).
        """
        return self.native_motion.part("bias", -1)

    @lazy
    def mechanical_connection(self) -> Array:
        """A (6, nv - 6) with base momentum h_0 = I_0 (v_0 + A joint_rates), eq. 17, base axes."""
        M = self.mass_matrix
        return read_only(np.linalg.solve(M[:6, :6], M[:6, 6:]))

    # ------------------------------------------------------------------ drifts

    @lazy
    def com_drift(self) -> Array:
        """Acceleration of the CoM at zero acceleration of v (3,) [m/s^2]."""
        return self.native_motion.drift("com_drift")

    @lazy
    def momentum_drift(self) -> Array:
        """dA_g/dt v (6,) [N, N m]: the momentum's rate at zero acceleration."""
        return self.native_motion.drift("momentum_drift")

    def drift(self, frame: str) -> Array:
        """Acceleration (6,) of the frame at zero acceleration of v, world axes [m/s^2, rad/s^2]."""
        return self.native_motion.frame_drift(self.robot.frame_id(frame))

    @lazy
    def inertia_drift(self) -> Array:
        """d^2 vech(I)/dt^2 (6,) at zero acceleration of v, world axes [kg m^2/s^2]."""
        return self.native_motion.drift("inertia_curvature")

    def inertia_drift_in(self, frame: str = WORLD, about: str | ArrayLike = COM) -> Array:
        """Second derivative (6,) of :meth:`inertia_in`, same ``frame`` and ``about``: the drift.

        In a frame that turns at w, at the rate a of zero acceleration of v, the inertia R' I R has
        the second derivative R' (I'' - 2 [w, I'] - [a, I] + [w, [w, I]]) R, in the commutator of
        skew matrices.
        """
        rate, drift = self.native_motion.drift("inertia_rate"), self.inertia_drift
        if not is_com(about):
            arm, speed, mass = self.arm(about), self.arm_jacobian(about) @ self.v, self.robot.mass
            rate = rate + parallel_axis_rates(mass, arm) @ speed
            more = parallel_axis_curvature(mass, arm, speed, self.arm_drift(about))
            drift = read_only(drift + more)
        if frame == WORLD:
            return drift
        rate, total = vech_inverse(rate), vech_inverse(drift)
        R, turn = self.rotation(frame), self.jacobian(frame)[3:] @ self.v
        W, A, inertia = skew(turn), skew(self.drift(frame)[3:]), self.inertia_in(WORLD, about)
        half = W @ inertia - inertia @ W - 2.0 * rate
        total = total + W @ half - half @ W - A @ inertia + inertia @ A
        return read_only(vech(R.T @ total @ R))

    def arm_drift(self, about: str | ArrayLike) -> Array:
        """Second derivative (3,) of :meth:`arm` at zero acceleration of v [m/s^2]."""
        if is_com(about):
            return np.zeros(3)
        frame, drift = moving_frame(about), self.com_drift
        return drift if frame is None else np.subtract(drift, self.drift(frame)[:3])

    @lazy
    def native_motion(self) -> NativeMotion:
        """The core's velocity-dependent results."""
        return self.native_state.motion(self.v)
