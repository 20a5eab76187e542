"""A plan's motion in the coordinates of the pendulums: what their dynamics and laws work with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.rmp.plan.plan import Plan, Trajectory
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array, read_only


@dataclass(frozen=True, eq=False)
class Generalised:
    """Motion of a pendulum at n moments in stance, in the order of its Q, V and F.

    Attributes
    ----------
    q, v, a:
        (n, nq), (n, nv), (n, nv); the CoP's acceleration, first in a, is zero between knots.
    forces:
        (n, nf): those of the ground, of the torque between leg and masses, and along the rails.
    """

    q: Array
    v: Array
    a: Array
    forces: Array

    def __post_init__(self) -> None:
        for array in (self.q, self.v, self.a, self.forces):
            read_only(array)


def generalised(plan: Plan, motion: Trajectory) -> Generalised:
    """Return a plan's motion in the coordinates of its own pendulum.

    Raises
    ------
    InvalidInputError
        A moment in flight: without ground there is no CoP, and so no leg.
    """
    flies = np.array([phase.flies for phase in plan.problem.schedule])[motion.phase]
    if flies.any():
        first = motion.time[flies][0]
        raise InvalidInputError(
            f"generalised: at {first:g} s the plan is in flight, where the pendulum has no CoP to"
            " stand on; leave such moments out"
        )
    pendulum = plan.problem.pendulum
    if isinstance(pendulum, PlanarRmp):
        return _planar(pendulum, motion)
    return _solid(pendulum, motion)


def _solid(pendulum: SolidRmp, m: Trajectory) -> Generalised:
    angles, rates, accelerations, push = _leg(m)
    R = Rotation.from_quat(m.orientation).as_matrix()
    torque = np.einsum("nji,nj->ni", R, m.momentum_rate)
    w = np.einsum("nji,nj->ni", R, m.angular_velocity)
    # Euler: torque = I w' + I' w + w x I w.
    products = m.radii * m.radii_rates
    inertia_rate = pendulum.mass * 2.0 / 3.0 * (products.sum(axis=1)[:, None] - products)
    w_rate = (torque - inertia_rate * w - np.cross(w, m.inertia * w)) / m.inertia
    q = np.hstack((m.cop, angles, m.orientation, m.radii))
    forces = np.array([pendulum.hip_torque(*each) for each in zip(q, torque, strict=True)])
    forces[:, 2] = push
    squares = w**2
    outward = m.radii * (squares.sum(axis=1)[:, None] - squares)
    forces[:, 6:] = pendulum.mass / 3.0 * (m.radii_accelerations - outward)
    return Generalised(
        q=q,
        v=np.hstack((m.cop_velocity, rates, w, m.radii_rates)),
        a=np.hstack((np.zeros((len(q), 2)), accelerations, w_rate, m.radii_accelerations)),
        forces=forces,
    )


def _planar(pendulum: PlanarRmp, m: Trajectory) -> Generalised:
    """Return the slice: angles from x to z, which is about -y; M r^2 is the inertia about y."""
    (theta, _, length), (theta_v, _, length_v), (theta_a, _, length_a), push = (
        x.T for x in _leg(m)
    )
    # sqrt(2/3) of the solid's r_1.
    r, r_v, r_a = (
        np.sqrt(2.0 / 3.0) * x[:, 0] for x in (m.radii, m.radii_rates, m.radii_accelerations)
    )
    w, torque, zero = -m.angular_velocity[:, 1], -m.momentum_rate[:, 1], np.zeros(len(m.time))
    w_rate = (torque - 2.0 * pendulum.mass * r * r_v * w) / m.inertia[:, 1]
    # The wheel's angle in space, continued over time; half angles of unit quaternions about y.
    wheel = -np.unwrap(2.0 * np.arctan2(m.orientation[:, 1], m.orientation[:, 3]))
    rail = pendulum.mass * (r_a - r * w**2)
    return Generalised(
        q=np.column_stack((m.cop[:, 0], theta, length, wheel - theta, r)),
        v=np.column_stack((m.cop_velocity[:, 0], theta_v, length_v, w - theta_v, r_v)),
        a=np.column_stack((zero, theta_a, length_a, w_rate - theta_a, r_a)),
        # No torque about a true CoP: tau_theta is zero.
        forces=np.column_stack((zero, push, torque, rail)),
    )


def _leg(m: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Return (theta, phi, r_l), its rates and accelerations (n, 3); the push along it (n,)."""
    leg, leg_v = np.array(m.com), np.array(m.com_velocity)
    leg[:, :2] -= m.cop
    leg_v[:, :2] -= m.cop_velocity
    (x, y, z), (vx, vy, vz), (ax, ay, az) = leg.T, leg_v.T, m.com_acceleration.T
    flat, length = np.hypot(x, z), np.linalg.norm(leg, axis=1)
    flat_v = (x * vx + z * vz) / flat
    flat_a = (vx**2 + vz**2 + x * ax + z * az - flat_v**2) / flat
    length_v = (x * vx + y * vy + z * vz) / length
    length_a = (vx**2 + vy**2 + vz**2 + x * ax + y * ay + z * az - length_v**2) / length
    theta_v = (x * vz - z * vx) / flat**2
    theta_a = (x * az - z * ax) / flat**2 - 2.0 * theta_v * flat_v / flat
    phi_v = (flat * vy - y * flat_v) / length**2
    phi_a = (flat * ay - y * flat_a) / length**2 - 2.0 * phi_v * length_v / length
    return (
        np.column_stack((np.arctan2(z, x), np.arctan2(y, flat), length)),
        np.column_stack((theta_v, phi_v, length_v)),
        np.column_stack((theta_a, phi_a, length_a)),
        (leg * m.force).sum(axis=1) / length,
    )
