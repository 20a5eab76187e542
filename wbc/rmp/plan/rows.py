"""The constraints of a plan by name: what each row means, its bounds and its unit."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.rmp.plan import polynomial as poly
from wbc.rmp.plan.interval import Motion
from wbc.rmp.plan.limits import FREE, Limits
from wbc.rmp.plan.problem import Weights
from wbc.validate import Array

# Largest component of an orientation's parameters: 80 degrees before the singular full turn.
TURN = 2.7


@dataclass(frozen=True, eq=False)
class Row:
    """Rows of one constraint, divided by its scale: lower <= value <= upper.

    ``hard`` rows are equations of motion, which no search for contradictions may break.
    """

    quantity: str
    value: ca.SX
    lower: float
    upper: float
    hard: bool = False


def scales(mass: float, gravity: float, length: float) -> dict[str, float]:
    """Return what one scaled unit of each variable is, SI: sizes of a pendulum of that length."""
    speed, time = float(np.sqrt(gravity * length)), float(np.sqrt(length / gravity))
    return {
        "com": length,
        "com_velocity": speed,
        "orientation": 1.0,
        "momentum": 0.1 * mass * length * speed,
        "radii": 0.3 * length,
        "radii_rates": 0.3 * speed,
        "radii_accelerations": 0.3 * gravity,
        "force": mass * gravity,
        "cop": 0.3 * length,
        "moment": 0.03 * mass * gravity * length,
        "time": time,
    }


def boxes(limits: Limits) -> dict[str, tuple[Array, Array]]:
    """Return (lower, upper) of states and controls at a knot, by name, SI."""

    def within(size: float) -> tuple[Array, Array]:
        return np.full(3, -size), np.full(3, size)

    least, greatest = limits.normal_force
    side = min(limits.force, limits.friction * greatest)
    return {
        "com": (
            np.array((-FREE, -FREE, limits.height[0])),
            np.array((FREE, FREE, limits.height[1])),
        ),
        "com_velocity": within(FREE),
        "orientation": within(TURN),
        "momentum": within(limits.momentum),
        "radii": (np.full(3, limits.radius[0]), np.full(3, limits.radius[1])),
        "radii_rates": within(limits.radius_rate),
        "radii_accelerations": within(limits.radius_acceleration),
        "force": (
            np.array((-side, -side, least)),
            np.array((side, side, min(greatest, limits.force))),
        ),
        "cop": (np.full(2, -FREE), np.full(2, FREE)),
        "moment": (np.zeros(1), np.zeros(1))
        if limits.torsion == 0.0
        else (np.full(1, -FREE), np.full(1, FREE)),
    }


def dynamics(m: Motion, scale: dict[str, float], kept: dict[str, list[int]]) -> list[Row]:
    """Return the equations of motion: each polynomial ends where the next begins.

    ``kept`` names the components that are not implied by others (slice, flight).
    """
    right = m.ends[1]
    ends = {
        "com": m.com,
        "com_velocity": m.velocity,
        "momentum": m.momentum,
        "radii": m.radii,
        "radii_rates": m.rates,
    }
    rows = [
        Row(
            f"dynamics of {name}",
            ((poly.value(p, 1.0) - right[name]) / scale[name])[kept[name]],
            0.0,
            0.0,
            hard=True,
        )
        for name, p in ends.items()
        if kept[name]
    ]
    turning = m.collocation.numel() // 3
    chosen = [3 * i + k for i in range(turning) for k in kept["orientation"]]
    rows.append(Row("dynamics of orientation", m.collocation[chosen], 0.0, 0.0, hard=True))
    return rows


def between_knots(m: Motion, scale: dict[str, float], limits: Limits) -> list[Row]:
    """Return what keeps the limits between knots: bounds on Bernstein's inner coefficients."""
    rows = []

    def enclose(name: str, p: poly.Polynomial, pair: tuple[float, float], unit: float) -> None:
        if pair != (-FREE, FREE):
            inner = ca.vertcat(*poly.bernstein(p)[1:-1])
            rows.append(Row(name, inner / unit, pair[0] / unit, pair[1] / unit))

    enclose("height", [x[2] for x in m.com], limits.height, scale["com"])
    enclose("radius", m.radii, limits.radius, scale["radii"])
    fastest, most = limits.radius_rate, limits.momentum
    enclose("radius_rate", m.rates, (-fastest, fastest), scale["radii_rates"])
    if "force" not in m.controls:
        return rows
    enclose("momentum", m.momentum, (-most, most), scale["momentum"])
    short, long = limits.leg_length
    square = poly.product(m.leg, m.leg, ca.dot)
    enclose("leg_length", square, (short**2, long**2), scale["com"] ** 2)
    push = poly.product(m.leg, m.controls["force"], ca.dot)
    enclose("leg_push", push, (0.0, FREE), scale["force"] * scale["com"])
    if limits.torque < FREE:
        # The ball is convex: it holds the polynomial if it holds all its coefficients.
        inner = [ca.sumsqr(b) / limits.torque**2 for b in poly.bernstein(m.torque)[1:-1]]
        rows.append(Row("torque", ca.vertcat(*inner), -FREE, 1.0))
    return rows


def at_stance_knot(m: Motion, scale: dict[str, float], limits: Limits) -> list[Row]:
    """Return the limits at the left knot of an interval in stance that no box can hold.

    Those on force and CoP are convex, and both are linear in time: they hold in between too.
    """
    f, weight = m.controls["force"][0], scale["force"]
    leg, torque = m.leg[0], m.torque[0]
    length = scale["com"]
    short, long = limits.leg_length
    rows = [
        Row("leg_length", ca.sumsqr(leg) / length**2, (short / length) ** 2, (long / length) ** 2),
        Row("leg_push", ca.dot(leg, f) / (weight * length), 0.0, FREE),
    ]
    if limits.friction < FREE:
        cone = limits.friction**2 * f[2] ** 2 - f[0] ** 2 - f[1] ** 2
        rows.append(Row("friction", cone / weight**2, 0.0, FREE))
    if limits.force < FREE:
        rows.append(Row("force", ca.sumsqr(f) / weight**2, -FREE, (limits.force / weight) ** 2))
    if limits.torsion > 0.0:
        m_z, most = m.controls["moment"][0], limits.torsion * f[2]
        both = ca.vertcat(most - m_z, most + m_z) / scale["moment"]
        rows.append(Row("torsion", both, 0.0, FREE))
    if limits.torque < FREE:
        rows.append(Row("torque", ca.sumsqr(torque) / limits.torque**2, -FREE, 1.0))
    return rows


def running_cost(m: Motion, weights: Weights, nominal: dict[str, Array], mass: float) -> ca.SX:
    """Return the cost of an interval; ``nominal`` holds values with NaN where there is none."""
    h, u = m.duration, m.controls

    def square(p: poly.Polynomial) -> ca.SX:
        """Return the mean of |p|^2 by Simpson's rule, exact up to degree one of p."""
        return (
            ca.sumsqr(poly.value(p, 0.0))
            + 4 * ca.sumsqr(poly.value(p, 0.5))
            + ca.sumsqr(poly.value(p, 1.0))
        ) / 6

    cost = weights.radius_acceleration * square(u["radii_accelerations"])
    cost += weights.momentum / mass**2 * square(m.momentum)
    if "force" in u:
        cost += weights.acceleration * square(m.acceleration)
        cost += weights.torque / mass**2 * square(m.torque)
        cost += weights.moment / mass**2 * square(u["moment"])
        cost += weights.force_rate / mass**2 * ca.sumsqr(u["force"][1]) / h**2
        cost += weights.cop_rate * ca.sumsqr(u["cop"][1]) / h**2
    drawn = (
        ("com", weights.com, m.com),
        ("radii", weights.radii, m.radii),
        ("orientation", 16.0 * weights.rotation, m.orientation),
    )
    for name, weight, p in drawn:
        target = nominal.get(name, np.full(3, np.nan))
        places = np.flatnonzero(np.isfinite(target)).tolist()
        if places:
            away = [p[0] - ca.DM(np.nan_to_num(target)), *p[1:]]
            cost += weight * square([x[places] for x in away])
    return h * cost + weights.time * h
