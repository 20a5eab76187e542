"""The solid pendulum over one interval of time, symbolic: what collocation needs of it.

The ground force, CoP, moment about the vertical and the masses' accelerations are linear in time.
So the motion of the CoM and of the radii is cubic, and k_G of degree five: they are integrated in
closed form, which is what collocation of their degree comes to. Only the orientation is
collocated,

    sigma' = 1/4 B(sigma) I(r)^-1 R(sigma)^T k_G
    B = (1 - |sigma|^2) 1 + 2 [sigma]x + 2 sigma sigma^T

at Radau's nodes (Schaub & Junkins, "Analytical Mechanics of Space Systems", on MRPs).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.rmp.frames import rotation_rows
from wbc.rmp.plan import polynomial as poly
from wbc.rmp.plan.polynomial import Polynomial

# Entries of a state at a knot, each with three components.
STATE = ("com", "com_velocity", "orientation", "momentum", "radii", "radii_rates")
STATES = 18
# Entries of the controls at a knot and their sizes; flight has the first only.
CONTROLS = {"radii_accelerations": 3, "force": 3, "cop": 2, "moment": 1}


@dataclass(frozen=True, eq=False)
class Motion:
    """Polynomials of the motion over an interval; see :func:`motion`.

    Attributes
    ----------
    z:
        Symbols (nz,), scaled: state and controls at both knots, inner nodes of sigma, duration.
    duration:
        Of the interval [s].
    ends:
        States by name at both knots, SI.
    controls:
        By name, of degree one.
    """

    z: ca.SX
    duration: ca.SX
    ends: tuple[dict[str, ca.SX], dict[str, ca.SX]]
    controls: dict[str, Polynomial]
    com: Polynomial
    velocity: Polynomial
    acceleration: Polynomial
    leg: Polynomial
    torque: Polynomial
    momentum: Polynomial
    radii: Polynomial
    rates: Polynomial
    orientation: Polynomial
    collocation: ca.SX


def controls_of(flies: bool) -> dict[str, int]:
    """Return the controls of a phase and their sizes."""
    return {"radii_accelerations": 3} if flies else dict(CONTROLS)


def motion(
    scale: dict[str, float],
    constants: tuple[float, float, tuple[float, float, float, float]],
    degree: int,
    flies: bool,
    intervals: int,
) -> Motion:
    """Return the motion over one of ``intervals`` equal intervals of a phase.

    Parameters
    ----------
    scale:
        What a scaled unit of each state and control is, SI; ``time`` for the phase's duration.
    constants:
        Mass, gravity and reference orientation.
    degree:
        Number of Radau's nodes.
    """
    mass, gravity, reference = constants
    names = controls_of(flies)
    knot = STATES + sum(names.values())
    z = ca.SX.sym("z", 2 * knot + 3 * (degree - 1) + 1)
    h = scale["time"] * z[-1] / intervals
    left, right = _split(z[:knot], scale, names), _split(z[knot : 2 * knot], scale, names)
    u = {name: poly.line(left[name], right[name]) for name in names}
    zero = ca.SX.zeros(3)
    force = [zero] if flies else u["force"]
    pull = [ca.DM([0.0, 0.0, -gravity]) + zero]
    acceleration = poly.total(poly.scaled(force, 1.0 / mass), pull)
    velocity = poly.integral(acceleration, left["com_velocity"], h)
    com = poly.integral(velocity, left["com"], h)
    rates = poly.integral(u["radii_accelerations"], left["radii_rates"], h)
    radii = poly.integral(rates, left["radii"], h)
    if flies:
        leg, torque = com, [zero]
    else:
        cop = [ca.vertcat(p, 0.0) for p in u["cop"]]
        leg = poly.total(com, poly.scaled(cop, -1.0))
        about = [ca.vertcat(0.0, 0.0, m) for m in u["moment"]]
        torque = poly.total(poly.scaled(poly.product(leg, force, ca.cross), -1.0), about)
    momentum = poly.integral(torque, left["momentum"], h)
    inner = ca.reshape(z[2 * knot : -1], 3, degree - 1)
    nodes = ca.horzcat(left["orientation"], inner, right["orientation"])
    places = poly.radau_nodes(degree)
    L, D = poly.lagrange([0.0, *places])
    defects = []
    for i, s in enumerate(places, start=1):
        k, r = poly.value(momentum, s), poly.value(radii, s)
        rate = orientation_rate(nodes[:, i], k, r, mass, reference)
        defects.append(nodes @ ca.DM(D[i]) - h * rate)
    turned = [nodes @ ca.DM(L[:, k]) for k in range(degree + 1)]
    return Motion(
        z=z,
        duration=h,
        ends=(left, right),
        controls=u,
        com=com,
        velocity=velocity,
        acceleration=acceleration,
        leg=leg,
        torque=torque,
        momentum=momentum,
        radii=radii,
        rates=rates,
        orientation=turned,
        collocation=ca.vertcat(*defects),
    )


def orientation_rate(
    sigma: ca.SX,
    momentum: ca.SX,
    radii: ca.SX,
    mass: float,
    reference: tuple[float, float, float, float],
) -> ca.SX:
    """Return d sigma/dt (3,) from the angular momentum and the masses' radii."""
    w = body_rate(sigma, momentum, radii, mass, reference)
    norm = ca.sumsqr(sigma)
    return ((1 - norm) * w + 2 * ca.cross(sigma, w) + 2 * ca.dot(sigma, w) * sigma) / 4


def body_rate(
    sigma: ca.SX,
    momentum: ca.SX,
    radii: ca.SX,
    mass: float,
    reference: tuple[float, float, float, float],
) -> ca.SX:
    """Return the body rate w (3,) [rad/s] from k_G = R I w."""
    axes = ca.DM(np.array(rotation_rows(*reference)))
    squares = radii**2
    inertia = mass / 3.0 * (ca.sum1(squares) - squares)
    return (rotation(sigma).T @ (axes.T @ momentum)) / inertia


def rotation(sigma: ca.SX) -> ca.SX:
    """Return the rotation matrix (3, 3), from body to reference, of MRPs."""
    norm = ca.sumsqr(sigma)
    S = ca.skew(sigma)
    return ca.SX.eye(3) + (8 * S @ S + 4 * (1 - norm) * S) / (1 + norm) ** 2


def _split(z: ca.SX, scale: dict[str, float], controls: dict[str, int]) -> dict[str, ca.SX]:
    out, at = {}, 0
    for name, size in (dict.fromkeys(STATE, 3) | controls).items():
        out[name] = scale[name] * z[at : at + size]
        at += size
    return out
