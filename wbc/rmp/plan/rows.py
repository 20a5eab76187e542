"""A plan's constraints by name, and its cost: nonlinear rows of an interval or knot, linear rows.

All are in scaled units.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wbc.rmp.plan.layout import PlanLayout, moving
from wbc.rmp.plan.motion import IntervalMotion, Polynomial
from wbc.rmp.plan.problem import PlanProblem, Weights
from wbc.rmp.plan.schedule import FREE, PathLimits, overlap, support_bounds
from wbc.validate import Array

# Largest component of an orientation's parameters: 80 degrees before the singular full turn.
TURN = 2.7


@dataclass(frozen=True, eq=False)
class PlanRow:
    """Rows of one constraint: lower <= value <= upper.

    ``hard`` rows are equations of motion, which no search for conflicts may relax.
    """

    quantity: str
    value: ca.SX
    lower: float
    upper: float
    hard: bool = False


def boxes(limits: PathLimits) -> dict[str, tuple[Array, Array]]:
    """Return (lower, upper) of states and controls at a knot, by name, SI."""

    def within(*greatest: float) -> tuple[Array, Array]:
        return -np.array(greatest), np.array(greatest)

    low, high = limits.height
    short, long = limits.radius
    least, greatest = limits.normal_force
    side = min(limits.force, limits.friction * greatest)
    return {
        "com": (np.array((-FREE, -FREE, low)), np.array((FREE, FREE, high))),
        "com_velocity": within(FREE, FREE, FREE),
        "orientation": within(TURN, TURN, TURN),
        "momentum": within(*[limits.momentum] * 3),
        "radii": (np.full(3, short), np.full(3, long)),
        "radii_rates": within(*[limits.radius_rate] * 3),
        "radii_accelerations": within(*[limits.radius_acceleration] * 3),
        "force": (
            np.array((-side, -side, least)),
            np.array((side, side, min(greatest, limits.force))),
        ),
        "cop": within(FREE, FREE),
        "moment": within(0.0 if limits.torsion == 0.0 else FREE),
    }


def dynamics(
    m: IntervalMotion, units: dict[str, float], kept: dict[str, list[int]]
) -> list[PlanRow]:
    """Return the equations of motion: each polynomial ends where the next begins.

    ``kept`` are the components that are not implied by others (in the plane, in flight).
    """
    rows = []
    for name, p in m.states.items():
        if name != "orientation" and kept[name]:
            defect = (p(1.0) - m.right[name]) / units[name]
            rows.append(PlanRow(f"dynamics of {name}", defect[kept[name]], 0.0, 0.0, hard=True))
    turning = m.collocation.numel() // 3
    chosen = [3 * i + k for i in range(turning) for k in kept["orientation"]]
    rows.append(PlanRow("dynamics of orientation", m.collocation[chosen], 0.0, 0.0, hard=True))
    return rows


def between_knots(m: IntervalMotion, units: dict[str, float], limits: PathLimits) -> list[PlanRow]:
    """Return rows for limits between knots: bounds on inner Bernstein coefficients."""
    rows = []

    def enclose(name: str, p: Polynomial, pair: tuple[float, float], unit: float) -> None:
        if pair != (-FREE, FREE):
            inner = ca.vertcat(*p.bernstein()[1:-1])
            rows.append(PlanRow(name, inner / unit, pair[0] / unit, pair[1] / unit))

    enclose("height", m.states["com"][2], limits.height, units["com"])
    enclose("radius", m.states["radii"], limits.radius, units["radii"])
    fastest, most = limits.radius_rate, limits.momentum
    enclose("radius_rate", m.states["radii_rates"], (-fastest, fastest), units["radii_rates"])
    if "force" not in m.controls:
        return rows
    enclose("momentum", m.states["momentum"], (-most, most), units["momentum"])
    short, long = limits.leg_length
    enclose("leg_length", m.leg.times(m.leg, ca.dot), (short**2, long**2), units["com"] ** 2)
    push = m.leg.times(m.controls["force"], ca.dot)
    enclose("leg_push", push, (0.0, FREE), units["force"] * units["com"])
    if limits.torque < FREE:
        # A ball is convex: it contains the polynomial if it contains all coefficients.
        inner = [ca.sumsqr(b) / limits.torque**2 for b in m.torque.bernstein()[1:-1]]
        rows.append(PlanRow("torque", ca.vertcat(*inner), -FREE, 1.0))
    return rows


def at_stance_knot(m: IntervalMotion, units: dict[str, float], limits: PathLimits) -> list[PlanRow]:
    """Return the limits at the left knot of an interval in stance that are not boxes.

    Those on force and CoP are convex, and both are linear in time: they hold in between too.
    """
    f, leg, torque = m.controls["force"](0.0), m.leg(0.0), m.torque(0.0)
    weight, length = units["force"], units["com"]
    short, long = limits.leg_length
    rows = [
        PlanRow(
            "leg_length", ca.sumsqr(leg) / length**2, (short / length) ** 2, (long / length) ** 2
        ),
        PlanRow("leg_push", ca.dot(leg, f) / (weight * length), 0.0, FREE),
    ]
    if limits.friction < FREE:
        cone = limits.friction**2 * f[2] ** 2 - f[0] ** 2 - f[1] ** 2
        rows.append(PlanRow("friction", cone / weight**2, 0.0, FREE))
    if limits.force < FREE:
        rows.append(PlanRow("force", ca.sumsqr(f) / weight**2, -FREE, (limits.force / weight) ** 2))
    if limits.torsion > 0.0:
        m_z, most = m.controls["moment"](0.0), limits.torsion * f[2]
        both = ca.vertcat(most - m_z, most + m_z) / units["moment"]
        rows.append(PlanRow("torsion", both, 0.0, FREE))
    if limits.torque < FREE:
        rows.append(PlanRow("torque", ca.sumsqr(torque) / limits.torque**2, -FREE, 1.0))
    return rows


def running_cost(
    m: IntervalMotion, weights: Weights, nominal: dict[str, Array], mass: float
) -> ca.SX:
    """Return the cost of an interval; ``nominal`` holds values with NaN where there is none."""
    h, u = m.duration, m.controls

    def square(p: Polynomial) -> ca.SX:
        """Return the mean of |p|^2 by Simpson's rule, exact up to degree one of p."""
        return (ca.sumsqr(p(0.0)) + 4 * ca.sumsqr(p(0.5)) + ca.sumsqr(p(1.0))) / 6

    cost = weights.radius_acceleration * square(u["radii_accelerations"])
    cost += weights.momentum / mass**2 * square(m.states["momentum"])
    if "force" in u:
        force_rate, cop_rate = (u[name].coefficients[1] / h for name in ("force", "cop"))
        cost += weights.acceleration * square(m.acceleration)
        cost += weights.torque / mass**2 * square(m.torque)
        cost += weights.moment / mass**2 * square(u["moment"])
        cost += weights.force_rate / mass**2 * ca.sumsqr(force_rate)
        cost += weights.cop_rate * ca.sumsqr(cop_rate)
    # 16: sigma is the rotation vector / 4 for small angles.
    towards = {"com": weights.com, "radii": weights.radii, "orientation": 16.0 * weights.rotation}
    for name, weight in towards.items():
        target = nominal.get(name, np.full(3, np.nan))
        places = np.flatnonzero(np.isfinite(target)).tolist()
        if places:
            away = m.states[name] + Polynomial([-ca.SX(np.nan_to_num(target))])
            cost += weight * square(away[places])
    return h * cost + weights.time * h


# ------------------------------------------------------------------ linear rows across intervals


@dataclass(frozen=True, eq=False)
class LinearRow:
    """lower <= sum of coefficients times scaled variables <= upper."""

    label: str
    terms: dict[int, float]  # coefficients by indices of variables
    lower: float
    upper: float


def matrix_of(rows: Sequence[LinearRow], count: int) -> ca.DM:
    """Return the sparse matrix (rows, count) of linear rows."""
    row = [k for k, one in enumerate(rows) for _ in one.terms]
    column = [int(at) for one in rows for at in one.terms]
    values = ca.DM([a for one in rows for a in one.terms.values()])
    return ca.DM.triplet(row, column, values, len(rows), count)


def linear_rows(
    problem: PlanProblem, layout: PlanLayout, units: dict[str, float]
) -> list[LinearRow]:
    """Return all linear rows of a plan: supports, continuity, waypoints and goal, period."""
    rows = [*_supports(problem, layout, units["cop"]), *_continuity(problem, layout)]
    for where, k, state in problem.waypoints:
        for name, values in state.values(problem.mass).items():
            aims, places = values / units[name], layout.phases[k].named[name][-1]
            for c in moving(problem, name):
                if np.isfinite(aims[c]):
                    rows.append(LinearRow(f"{where}: {name}", {places[c]: 1.0}, aims[c], aims[c]))
    return [*rows, *_period(problem, layout, units)]


def _supports(problem: PlanProblem, layout: PlanLayout, unit: float) -> Iterator[LinearRow]:
    for phase, places in zip(problem.schedule, layout.phases, strict=True):
        if phase.support is None:
            continue
        for a, low, high in zip(*support_bounds(phase.support), strict=True):
            if problem.plane and abs(a[0]) < np.finfo(float).eps:
                continue  # a side parallel to the plane y = 0 bounds nothing in it
            for x, y in places.named["cop"].tolist():
                terms = {x: a[0]} if problem.plane else {x: a[0], y: a[1]}
                yield LinearRow(f"{phase.name}: cop", terms, low / unit, high / unit)


def _continuity(problem: PlanProblem, layout: PlanLayout) -> Iterator[LinearRow]:
    """Make the force continuous from stance to stance; and the CoP, unless feet must jump."""
    schedule = problem.schedule
    for k in range(1, len(schedule)):
        before, after = schedule[k - 1].support, schedule[k].support
        if before is None or after is None:
            continue
        for name in ("force", "cop", "moment") if overlap(before, after) else ("force",):
            if name == "moment" and problem.limits_of(k).torsion == 0.0:
                continue
            left, right = (layout.phases[j].named[name] for j in (k - 1, k))
            for c in moving(problem, name, left.shape[1]):
                terms = {right[0, c]: 1.0, left[-1, c]: -1.0}
                yield LinearRow(f"{schedule[k].name}: {name} at its start", terms, 0.0, 0.0)


def _period(
    problem: PlanProblem, layout: PlanLayout, units: dict[str, float]
) -> Iterator[LinearRow]:
    """Make the last state, force and CoP those of the first knot, moved by the stride."""
    for name, change in problem.period.items():
        start, end = layout.phases[0].named[name][0], layout.phases[-1].named[name][-1]
        for c in moving(problem, name, len(start)):
            if start[c] != end[c]:
                shift = change[c] / units[name]
                yield LinearRow(f"period: {name}", {end[c]: 1.0, start[c]: -1.0}, shift, shift)
