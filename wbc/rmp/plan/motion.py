"""The solid pendulum over one interval of time as symbolic polynomials, for collocation.

The ground force, CoP, moment about the vertical and the masses' accelerations are linear in time.
So the motion of the CoM and of the radii is cubic, and k_G of degree five: they are integrated in
closed form, which equals collocation of their degree. Only the orientation is collocated,

    sigma' = 1/4 B(sigma) I(r)^-1 R(sigma)^T k_G
    B = (1 - |sigma|^2) 1 + 2 [sigma]x + 2 sigma sigma^T

at Radau's nodes (Schaub & Junkins, "Analytical Mechanics of Space Systems", on MRPs).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from math import comb

import casadi as ca
import numpy as np

from wbc.placement import from_mrp
from wbc.rmp.plan.problem import PlanProblem
from wbc.rmp.plan.schedule import STATE
from wbc.rmp.solid import quaternion_product
from wbc.rotations import rotation_from
from wbc.validate import Array

# Controls at a knot and their sizes; flight has the first only.
CONTROLS = {"radii_accelerations": 3, "force": 3, "cop": 2, "moment": 1}


@dataclass(frozen=True, eq=False)
class Polynomial:
    """A polynomial in s = 0..1: coefficients of 1, s, s^2, ..., each a column of symbols.

    Bernstein's coefficients enclose it: a convex bound on each of them holds at every s.
    """

    coefficients: Sequence[ca.SX]

    @classmethod
    def line(cls, first: ca.SX, last: ca.SX) -> Polynomial:
        """Return the polynomial from one value to another."""
        return cls([first, last - first])

    def __add__(self, other: Polynomial) -> Polynomial:
        zero = ca.SX.zeros(self.coefficients[0].shape)
        pairs = zip_longest(self.coefficients, other.coefficients, fillvalue=zero)
        return Polynomial([a + b for a, b in pairs])

    def __mul__(self, factor: float) -> Polynomial:
        return Polynomial([factor * a for a in self.coefficients])

    def __getitem__(self, components: int | list[int]) -> Polynomial:
        return Polynomial([a[components] for a in self.coefficients])

    def __call__(self, s: ca.SX | float) -> ca.SX:
        """Return the value at s, by Horner's rule."""
        value = self.coefficients[-1]
        for a in self.coefficients[-2::-1]:
            value = a + s * value
        return value

    def times(self, other: Polynomial, product: Callable[[ca.SX, ca.SX], ca.SX]) -> Polynomial:
        """Return the product of both, by any bilinear product of their coefficients."""
        out = [ca.SX(0)] * (len(self.coefficients) + len(other.coefficients) - 1)
        for i, a in enumerate(self.coefficients):
            for j, b in enumerate(other.coefficients):
                out[i + j] = out[i + j] + product(a, b)
        return Polynomial(out)

    def integral(self, start: ca.SX, length: ca.SX) -> Polynomial:
        """Return start + length * the integral from 0 to s."""
        return Polynomial([start, *(length * a / (k + 1) for k, a in enumerate(self.coefficients))])

    def bernstein(self) -> list[ca.SX]:
        """Return Bernstein's coefficients; the first and the last are the values at the ends."""
        a, n = self.coefficients, len(self.coefficients) - 1
        return [
            sum((comb(k, i) / comb(n, i) * a[i] for i in range(1, k + 1)), a[0])
            for k in range(n + 1)
        ]


def lagrange(nodes: Sequence[float]) -> tuple[Array, Array]:
    """Return (L, D) of Lagrange's basis on nodes: power coefficients, and slopes at the nodes.

    The basis polynomial j is sum_k L[j, k] s^k, and its slope at node i is D[i, j].
    """
    powers = np.vander(np.array(nodes), increasing=True)
    L = np.linalg.inv(powers).T
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, len(nodes))
    return L, slopes @ L.T


@dataclass(frozen=True, eq=False)
class IntervalMotion:
    """Polynomials of the motion over an interval, SI; see :func:`motion`."""

    z: ca.SX  # scaled (nz,): state and controls at both knots, inner nodes of sigma, duration
    duration: ca.SX  # of the interval [s]
    right: dict[str, ca.SX]  # state at the right knot by name
    states: dict[str, Polynomial]
    controls: dict[str, Polynomial]  # of degree one
    acceleration: Polynomial  # c''
    leg: Polynomial  # from the CoP to the CoM (without meaning in flight)
    torque: Polynomial  # k_G'
    collocation: ca.SX  # defects of the orientation at its nodes (3 * degree,)


def controls_of(flies: bool) -> dict[str, int]:
    """Return the controls of a phase and their sizes."""
    return {"radii_accelerations": 3} if flies else dict(CONTROLS)


def motion(
    problem: PlanProblem, units: dict[str, float], flies: bool, intervals: int = 1
) -> IntervalMotion:
    """Return the motion over one of ``intervals`` equal intervals of a phase.

    ``units`` are those of :func:`~wbc.rmp.plan.layout.units_of`.
    """
    degree, controls = problem.degree, controls_of(flies)
    knot = 3 * len(STATE) + sum(controls.values())
    z = ca.SX.sym("z", 2 * knot + 3 * (degree - 1) + 1)
    h = units["time"] * z[-1] / intervals
    left, right = _split(z[:knot], units, controls), _split(z[knot : 2 * knot], units, controls)
    u = {name: Polynomial.line(left[name], right[name]) for name in controls}
    zero = ca.SX.zeros(3)
    force = Polynomial([zero]) if flies else u["force"]
    gravity = Polynomial([ca.DM([0.0, 0.0, -problem.gravity]) + zero])
    acceleration = force * (1.0 / problem.mass) + gravity
    velocity = acceleration.integral(left["com_velocity"], h)
    com = velocity.integral(left["com"], h)
    rates = u["radii_accelerations"].integral(left["radii_rates"], h)
    radii = rates.integral(left["radii"], h)
    leg, torque = com, Polynomial([zero])
    if not flies:
        cop = Polynomial([ca.vertcat(p, 0.0) for p in u["cop"].coefficients])
        leg = com + cop * -1.0
        moment = Polynomial([ca.vertcat(0.0, 0.0, m) for m in u["moment"].coefficients])
        torque = leg.times(force, ca.cross) * -1.0 + moment
    momentum = torque.integral(left["momentum"], h)
    inner = ca.reshape(z[2 * knot : -1], 3, degree - 1)
    nodes = ca.horzcat(left["orientation"], inner, right["orientation"])
    places = ca.collocation_points(degree, "radau")  # in (0, 1], the last at 1
    L, D = lagrange([0.0, *places])
    defects = [
        nodes @ ca.DM(D[i]) - h * orientation_rate(problem, nodes[:, i], momentum(s), radii(s))
        for i, s in enumerate(places, start=1)
    ]
    orientation = Polynomial([nodes @ ca.DM(L[:, k]) for k in range(degree + 1)])
    return IntervalMotion(
        z=z,
        duration=h,
        right=right,
        states=dict(zip(STATE, (com, velocity, orientation, momentum, radii, rates), strict=True)),
        controls=u,
        acceleration=acceleration,
        leg=leg,
        torque=torque,
        collocation=ca.vertcat(*defects),
    )


def orientation_rate(problem: PlanProblem, sigma: ca.SX, momentum: ca.SX, radii: ca.SX) -> ca.SX:
    """Return d sigma/dt (3,) from the angular momentum and the masses' radii."""
    w = body_rate(problem, sigma, momentum, radii)
    norm = ca.sumsqr(sigma)
    return ((1 - norm) * w + 2 * ca.cross(sigma, w) + 2 * ca.dot(sigma, w) * sigma) / 4


def body_rate(problem: PlanProblem, sigma: ca.SX, momentum: ca.SX, radii: ca.SX) -> ca.SX:
    """Return the body rate w (3,) [rad/s] from k_G = R I w."""
    inertia = principal_moments(problem.mass, radii)
    return (from_mrp(sigma).T @ (reference_axes(problem).T @ momentum)) / inertia


def principal_moments(mass: float, radii: ca.SX) -> ca.SX:
    """Return the moments of inertia (3,) about the masses' axes [kg m^2]."""
    squares = radii**2
    return mass / 3.0 * (ca.sum1(squares) - squares)


def reference_axes(problem: PlanProblem) -> ca.DM:
    """Return the rotation matrix (3, 3) of the reference orientation, to the world."""
    return ca.DM(rotation_from(np.array(problem.reference)))


def quaternion(problem: PlanProblem, sigma: ca.SX) -> ca.SX:
    """Return the quaternion (4,), x y z w, from body to world, of MRPs."""
    norm = ca.sumsqr(sigma)
    from_reference = ca.vertcat(2 * sigma, 1 - norm) / (1 + norm)
    return quaternion_product(ca.SX(list(problem.reference)), from_reference)


def _split(z: ca.SX, units: dict[str, float], controls: dict[str, int]) -> dict[str, ca.SX]:
    """Return the parts of a knot's variables by name, SI."""
    out, at = {}, 0
    for name, size in (dict.fromkeys(STATE, 3) | controls).items():
        out[name] = units[name] * z[at : at + size]
        at += size
    return out
