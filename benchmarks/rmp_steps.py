"""Integrators of a pendulum with springs: on the rotation group, and Runge-Kutta.

A step is a CasADi Function (x, u) -> (x_next, residual) with x = (q, v) and u = (CoP acceleration,
generalised forces), constant through the step. ``residual`` is the error of an implicit step's
solution; it is zero for an explicit one. :func:`rollout` takes many steps.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from wbc.rmp.pendulum import ReactionMassPendulum
from wbc.rmp.solid import SolidRmp, leg_direction, quaternion_product
from wbc.validate import Array

# Rounds of fixed-point iteration of an implicit step. Each multiplies the error by about dt times
# the fastest rate (rad/s) over two, so that 16 reach rounding for dt * rate up to 0.2.
ROUNDS = 16
# Largest residual accepted: the change of the last round, in rad and relative to lengths.
SOLVED = 1e-10
# Steps taken in one call, so that memory for the call stays small.
CHUNK = 1000


class Springs(NamedTuple):
    """Linear springs on r_l and on every r_k; stiffnesses [N/m], and where they are slack [m]."""

    leg: float
    leg_rest: float
    masses: float
    masses_rest: Array  # (3,)

    def forces(self, model: ReactionMassPendulum, q: ca.SX) -> ca.SX:
        """Return the springs' generalised forces (nf,) at symbols or numbers q (nq,)."""
        f = type(q).zeros(len(model.F))
        f[model.F.index("f_l")] = -self.leg * (q[model.LEG] - self.leg_rest)
        f[-model.RADII :] = -self.masses * (q[-model.RADII :] - ca.DM(self.masses_rest))
        return f

    def energy(self, model: ReactionMassPendulum, q: Array) -> Array:
        """Return the energy stored at configurations q (..., nq) [J], one each."""
        leg = q[..., model.LEG] - self.leg_rest
        masses = q[..., -model.RADII :] - self.masses_rest
        return np.asarray(0.5 * self.leg * leg**2 + 0.5 * self.masses * (masses**2).sum(axis=-1))


SLACK = Springs(0.0, 0.0, 0.0, np.zeros(3))


def runge_kutta(model: ReactionMassPendulum, dt: float, springs: Springs = SLACK) -> ca.Function:
    """Return CasADi's classical step of fourth order; of a quaternion the norm is kept."""
    nq, nv = len(model.Q), len(model.V)
    x, u = ca.SX.sym("x", nq + nv), ca.SX.sym("u", nv)
    passive = ca.vertcat(ca.SX.zeros(model.COP), springs.forces(model, x[:nq]))
    rate = ca.Function("rate", [x, u], [model.functions["state_rate"](x, u + passive)])
    after = ca.simpleRK(rate, 1)(x, u, dt)
    if isinstance(model, SolidRmp):
        after[5:9] /= ca.norm_2(after[5:9])
    return _step("runge_kutta", x, u, after, ca.SX(0))


def energy_momentum(model: SolidRmp, dt: float, springs: Springs = SLACK) -> ca.Function:
    """Return an implicit step of second order that keeps energy and angular momentum.

    The rotation moves by the Cayley map of a mean body rate, so that the world's angular momentum
    of the masses is kept whatever the rate. Rate and sliding forces are a discrete gradient of the
    energy (differences over the step in the place of derivatives), so that the energy changes by
    the work of the given torques and mass forces, exactly, at any dt; so does a leg force's work.
    Without forces from outside, energy, k_G and the vertical part of k_P stay as they are, to
    rounding. ``tau_theta`` and ``tau_phi`` act as at mid-step; their work is right to second order.
    """
    x, u = ca.SX.sym("x", 23), ca.SX.sym("u", 11)
    masses = _masses_step(model, springs, dt, x, u)
    leg = _leg_step(model, springs, dt, x, u)
    q = ca.vertcat(leg[0], masses[0])
    v = ca.vertcat(leg[1], masses[1])
    return _step("energy_momentum", x, u, ca.vertcat(q, v), ca.fmax(masses[2], leg[2]))


def rollout(step: ca.Function, start: ArrayLike, inputs: ArrayLike, count: int) -> Array:
    """Return the states (count + 1, nx) from ``start`` (nx,), which is the first.

    ``inputs`` are one u (nu,) for all steps, or one for each (count, nu). A radius that passes
    through zero goes on as a negative one: the masses have changed sides.
    """
    each = np.broadcast_to(np.asarray(inputs, dtype=float), (count, step.size1_in(1)))
    states = np.empty((count + 1, step.size1_in(0)))
    states[0] = start
    for first in range(0, count, CHUNK):
        size = min(CHUNK, count - first)
        after, residuals = step.mapaccum(size)(states[first], each[first : first + size].T)
        states[first + 1 : first + 1 + size] = after.full().T
        if not np.isfinite(states[first + size]).all() or not residuals.full().max() <= SOLVED:
            raise ArithmeticError(f"not solved, or no longer finite, by step {first + size}")
    return states


def _step(name: str, x: ca.SX, u: ca.SX, after: ca.SX, residual: ca.SX) -> ca.Function:
    return ca.Function(name, [x, u], [after, residual], ["x", "u"], ["x_next", "residual"])


def _masses_step(
    model: SolidRmp, springs: Springs, dt: float, x: ca.SX, u: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return (quaternion, radii), (body rate, radii's rates) and the residual."""
    m, rest = model.mass / 3.0, ca.DM(springs.masses_rest)
    quaternion, r0, w0, slide = x[5:9], x[9:12], x[17:20], x[20:23]
    torque, push = u[5:8], u[8:11]
    I0 = m * (ca.sum1(r0**2) - r0**2)
    k0 = I0 * w0
    k1, r1 = k0, r0 + dt * slide
    a, residual = ca.SX.zeros(3), ca.SX(0)
    for _ in range(ROUNDS):
        before = ca.vertcat(a, r1 / ca.norm_2(r0))
        I1 = m * (ca.sum1(r1**2) - r1**2)
        a = dt / 4 * (1 / I0 + 1 / I1) * (k0 + k1) / 2  # half the mean rotation vector
        force = push - springs.masses * ((r0 + r1) / 2 - rest)
        # Centrifugal: -(1/2) k^2 d(1/I)/dr with the difference quotient of 1/I.
        share = (k0**2 + k1**2) / 2 / (I0 * I1)
        force += m * (r0 + r1) / 2 * (ca.sum1(share) - share)
        k1 = _cayley_solve(a, k0 - ca.cross(a, k0) + dt * torque)
        r1 = r0 + dt * slide + dt**2 / (2 * m) * force
        residual = ca.norm_inf(ca.vertcat(a, r1 / ca.norm_2(r0)) - before)
    turned = quaternion_product(quaternion, ca.vertcat(a, 1.0))
    I1 = m * (ca.sum1(r1**2) - r1**2)
    q = ca.vertcat(turned / ca.norm_2(turned), r1)
    return q, ca.vertcat(k1 / I1, 2 * (r1 - r0) / dt - slide), residual


def _cayley_solve(a: ca.SX, y: ca.SX) -> ca.SX:
    """Return z with z + a x z = y."""
    return (y - ca.cross(a, y) + a * ca.dot(a, y)) / (1 + ca.sumsqr(a))


def _leg_step(
    model: SolidRmp, springs: Springs, dt: float, x: ca.SX, u: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return (CoP, leg angles, length), their rates and the residual; the CoM moves in space."""
    cop, cop_rate, push = x[:2], x[12:14], u[:2]
    moved = ca.vertcat(dt * cop_rate + dt**2 / 2 * push, 0.0)
    cop_after = ca.vertcat(cop_rate + dt * push, 0.0)
    l0 = x[4] * leg_direction(x[2], x[3])
    com_rate = ca.vertcat(cop_rate, 0.0) + ca.jtimes(l0, x[2:5], x[14:17])
    weight = ca.DM([0.0, 0.0, -model.mass * model.gravity])
    l1, residual = l0 + dt * com_rate - moved, ca.SX(0)
    for _ in range(ROUNDS):
        before = l1
        long = (ca.norm_2(l0) + ca.norm_2(l1)) / 2
        along = u[4] - springs.leg * (long - springs.leg_rest)
        middle = (l0 + l1) / 2
        # Half of the difference of |l|^2 is the mean leg times its change: work is exact so.
        force = along * middle / long + _sideways(middle, u[2], u[3]) + weight
        l1 = l0 + dt * com_rate + dt**2 / (2 * model.mass) * force - moved
        residual = ca.norm_inf(l1 - before) / ca.norm_2(l0)
    rate = com_rate + dt / model.mass * force - cop_after
    flat, length = ca.sqrt(l1[0] ** 2 + l1[2] ** 2), ca.norm_2(l1)
    # Continued from theta, not wrapped.
    theta = x[2] + ca.atan2(l0[0] * l1[2] - l0[2] * l1[0], l0[0] * l1[0] + l0[2] * l1[2])
    q = ca.vertcat(cop + moved[:2], theta, ca.atan2(l1[1], flat), length)
    theta_rate = (l1[0] * rate[2] - l1[2] * rate[0]) / flat**2
    flat_rate = (l1[0] * rate[0] + l1[2] * rate[2]) / flat
    phi_rate = (flat * rate[1] - l1[1] * flat_rate) / length**2
    return q, ca.vertcat(cop_after[:2], theta_rate, phi_rate, ca.dot(l1, rate) / length), residual


def _sideways(leg: ca.SX, tau_theta: ca.SX, tau_phi: ca.SX) -> ca.SX:
    """Return the force (3,) on the CoM, across the leg, of the torques of its angles."""
    x, y, z = ca.vertsplit(leg)
    flat = ca.sqrt(x**2 + z**2)
    by_theta = ca.vertcat(-z, 0.0, x) / flat**2
    by_phi = ca.vertcat(-x * y / flat, flat, -z * y / flat) / ca.sumsqr(leg)
    return tau_theta * by_theta + tau_phi * by_phi
