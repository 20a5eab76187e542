"""A plan's motion in the coordinates of the pendulums: what their dynamics and laws work with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.rmp.plan.plan import Plan, Trajectory
from wbc.rmp.plan.problem import Pendulum
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
    pendulum: Pendulum = plan.problem.pendulum
    if isinstance(pendulum, PlanarRmp):
        return _planar(pendulum, motion, plan.problem.reference)
    return _solid(pendulum, motion)


def _solid(pendulum: SolidRmp, m: Trajectory) -> Generalised:
    angles, rates, turns = _leg(m)
    n = len(m.time)
    R = Rotation.from_quat(m.orientation).as_matrix()
    torque = np.einsum("nji,nj->ni", R, m.momentum_rate)
    w = np.einsum("nji,nj->ni", R, m.angular_velocity)
    # Euler: torque = I w' + I' w + w x I w.
    products = m.radii * m.radii_rates
    changing = pendulum.mass * 2.0 / 3.0 * (products.sum(axis=1)[:, None] - products)
    w_rate = (torque - changing * w - np.cross(w, m.inertia * w)) / m.inertia
    q = np.hstack((m.cop, angles, m.orientation, m.radii))
    v = np.hstack((m.cop_velocity, rates, w, m.radii_rates))
    a = np.hstack((np.zeros((n, 2)), turns, w_rate, m.radii_accelerations))
    leg = _leg_vector(m)[0]
    forces = np.array([pendulum.hip_torque(q[i], torque[i]) for i in range(n)])
    forces[:, 2] = (leg * m.force).sum(axis=1) / angles[:, 2]
    squares = w**2
    outward = m.radii * (squares.sum(axis=1)[:, None] - squares)
    forces[:, 6:] = pendulum.mass / 3.0 * (m.radii_accelerations - outward)
    return Generalised(q, v, a, forces)


def _planar(
    pendulum: PlanarRmp, m: Trajectory, reference: tuple[float, float, float, float]
) -> Generalised:
    """Return the slice: angles from x to z, which is about -y; M r^2 is the inertia about y."""
    angles, rates, turns = _leg(m)
    n = len(m.time)
    part = np.sqrt(2.0 / 3.0)
    r, r_rate, r_turn = (part * x[:, 0] for x in (m.radii, m.radii_rates, m.radii_accelerations))
    inertia, spin = m.inertia[:, 1], -m.angular_velocity[:, 1]
    torque = -m.momentum_rate[:, 1]
    spin_rate = (torque - 2.0 * pendulum.mass * r * r_rate * spin) / inertia
    # The wheel's angle in space, continued over time; half angles of unit quaternions about y.
    wheel = -np.unwrap(2.0 * np.arctan2(m.orientation[:, 1], m.orientation[:, 3]))
    theta, length = angles[:, 0], angles[:, 2]
    zero = np.zeros(n)
    q = np.column_stack((m.cop[:, 0], theta, length, wheel - theta, r))
    v = np.column_stack(
        (m.cop_velocity[:, 0], rates[:, 0], rates[:, 2], spin - rates[:, 0], r_rate)
    )
    a = np.column_stack((zero, turns[:, 0], turns[:, 2], spin_rate - turns[:, 0], r_turn))
    along = (_leg_vector(m)[0] * m.force).sum(axis=1) / length
    slide = pendulum.mass * (r_turn - r * spin**2)
    # No torque about a true CoP: tau_theta is zero.
    return Generalised(q, v, a, np.column_stack((zero, along, torque, slide)))


def _leg_vector(m: Trajectory) -> tuple[Array, Array, Array]:
    """Return the leg c - p, its rate and its acceleration (n, 3)."""
    flat = np.zeros((len(m.time), 1))
    return (
        m.com - np.hstack((m.cop, flat)),
        m.com_velocity - np.hstack((m.cop_velocity, flat)),
        m.com_acceleration,
    )


def _leg(m: Trajectory) -> tuple[Array, Array, Array]:
    """Return (theta, phi, r_l), their rates and accelerations, each (n, 3)."""
    l, v, a = (x.T for x in _leg_vector(m))  # noqa: E741
    flat, length = np.hypot(l[0], l[2]), np.linalg.norm(l, axis=0)
    flat_v = (l[0] * v[0] + l[2] * v[2]) / flat
    flat_a = (v[0] ** 2 + v[2] ** 2 + l[0] * a[0] + l[2] * a[2] - flat_v**2) / flat
    length_v = (l * v).sum(axis=0) / length
    length_a = ((v * v).sum(axis=0) + (l * a).sum(axis=0) - length_v**2) / length
    theta_v = (l[0] * v[2] - l[2] * v[0]) / flat**2
    theta_a = (l[0] * a[2] - l[2] * a[0]) / flat**2 - 2.0 * theta_v * flat_v / flat
    phi_v = (flat * v[1] - l[1] * flat_v) / length**2
    phi_a = (flat * a[1] - l[1] * flat_a) / length**2 - 2.0 * phi_v * length_v / length
    return (
        np.column_stack((np.arctan2(l[2], l[0]), np.arctan2(l[1], flat), length)),
        np.column_stack((theta_v, phi_v, length_v)),
        np.column_stack((theta_a, phi_a, length_a)),
    )
