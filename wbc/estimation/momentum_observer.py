"""External forces from joint torques: residuals of the generalised momentum.

With p = M v, M a + h = S' tau + J' f gives what acts from outside as J' f = p' - M' v + h - S' tau,
of which the observer r' = K (J' f - r) needs no acceleration (De Luca and Mattone, *Actuator
failure detection and isolation using generalized momenta*, ICRA 2003). Over a period M v grows by
M_k (v_{k+1} - v_k) + (M_{k+1} - M_k) v_{k+1}, and the second term is what M' v takes off, so that

    r += (1 - exp(-K dt)) (M_k (v_{k+1} - v_k) / dt + h_k - S' tau - r)

needs no derivative of M either.
"""

from __future__ import annotations

import math

import numpy as np

from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NV
from wbc.validate import Array, finite_number

# Least joint speed [rad/s or m/s] at which dry friction is taken for all that it is.
CREEP = 0.05
DAMPING = 1e-3  # m^2: squared lever of a joint below which it says little of a force


class MomentumObserver:
    """Generalised force from outside (nv,), base first in base axes, low-passed.

    Parameters
    ----------
    bandwidth:
        K [1/s]: what acts is seen with a delay of 1/K.

    Attributes
    ----------
    residual:
        (nv,) [N, N m].
    """

    def __init__(self, robot: Robot, bandwidth: float = 150.0) -> None:
        self.robot = robot
        self.bandwidth = finite_number("momentum observer, bandwidth", bandwidth, above=0.0)
        self.residual: Array = np.zeros(robot.nv)
        self._last: tuple[Array, Array, Array] | None = None

    def reset(self) -> None:
        """Forget everything; nothing acts."""
        self.residual = np.zeros(self.robot.nv)
        self._last = None

    def update(self, snapshot: Snapshot, torque: Array, dt: float) -> Array:
        """Take in the state now and the motors' torques (nv-6,) over the ``dt`` [s] before.

        Return the residual (nv,). The joints' damping and dry friction, as the robot has them, are
        taken off the torques.
        """
        v, robot = snapshot.v, self.robot
        if self._last is not None and dt > 0.0:
            M, h, before = self._last
            outside = M @ (v - before)
            outside /= dt
            outside += h
            rates = 0.5 * (before[BASE_NV:] + v[BASE_NV:])
            outside[BASE_NV:] -= torque - robot.damping * rates
            outside[BASE_NV:] += robot.friction * np.clip(rates / CREEP, -1.0, 1.0)
            self.residual = self.residual + (1.0 - math.exp(-self.bandwidth * dt)) * (
                outside - self.residual
            )
        self._last = snapshot.mass_matrix, snapshot.bias, v
        return self.residual

    def memory(self) -> tuple[Array, tuple[Array, Array, Array] | None]:
        """Return all that it knows, for :meth:`restore`; nothing of it is written to later."""
        return self.residual, self._last

    def restore(self, memory: tuple[Array, tuple[Array, Array, Array] | None]) -> None:
        """Go back to what :meth:`memory` returned."""
        self.residual, self._last = memory


def foot_wrenches(snapshot: Snapshot, residual: Array, base_trust: float = 0.1) -> dict[str, Array]:
    """Return wrenches (6,) on the soles by foot that explain a generalised force best.

    Least squares over all rows of J' f = r, moments counted by the size of a sole, a little
    damped, so that a straight leg gives no wild forces. World axes, at the sole's frame.

    Parameters
    ----------
    base_trust:
        Weight of the base's rows by the joints': accelerations of the whole mass are in them.
    """
    robot = snapshot.robot
    names = tuple(robot.feet)
    if not names:
        return {}
    J = np.concatenate([snapshot.jacobian(robot.feet[name].frame) for name in names])  # (6k, nv)
    weights = np.ones(robot.nv)
    weights[:BASE_NV] = base_trust
    weighted = J * weights
    A = weighted @ J.T
    A.flat[:: len(A) + 1] += DAMPING
    f = np.linalg.solve(A, weighted @ residual)
    return {name: f[6 * k : 6 * k + 6] for k, name in enumerate(names)}
