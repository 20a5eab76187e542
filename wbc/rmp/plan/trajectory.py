"""A plan's motion as arrays over time, and how it is read from the programme's variables."""

from __future__ import annotations

from dataclasses import dataclass, fields

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from wbc.rmp.frames import quaternion_product, rotation_rows
from wbc.rmp.plan import polynomial as poly
from wbc.rmp.plan.interval import body_rate, motion
from wbc.rmp.plan.interval import rotation as rotation_of
from wbc.rmp.plan.problem import PlanProblem
from wbc.validate import Array, read_only


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motion at n moments; vectors in world axes unless said otherwise. Read-only.

    Attributes
    ----------
    time:
        [s] (n,).
    phase:
        Places in the schedule (n,).
    com, com_velocity, com_acceleration:
        c, c', c'' (n, 3) [m, m/s, m/s^2].
    orientation:
        Of the masses' axes: quaternions (n, 4), x y z w.
    angular_velocity:
        Of the masses' axes (n, 3) [rad/s].
    momentum, momentum_rate:
        k_G and k_G' (n, 3) [kg m^2/s, N m].
    radii, radii_rates, radii_accelerations:
        r, r', r'' (n, 3).
    inertia:
        Principal moments about the masses' axes (n, 3) [kg m^2].
    force:
        Of the ground (n, 3) [N]; zero in flight.
    cop, cop_velocity:
        p and p' on the ground (n, 2) [m, m/s]; NaN in flight, where there is none.
    moment:
        About the vertical through the CoP (n,) [N m].
    """

    time: Array
    phase: NDArray[np.int64]
    com: Array
    com_velocity: Array
    com_acceleration: Array
    orientation: Array
    angular_velocity: Array
    momentum: Array
    momentum_rate: Array
    radii: Array
    radii_rates: Array
    radii_accelerations: Array
    inertia: Array
    force: Array
    cop: Array
    cop_velocity: Array
    moment: Array

    def __post_init__(self) -> None:
        for each in fields(self):
            getattr(self, each.name).flags.writeable = False


# What a sampler returns, in its order, with sizes.
_SAMPLED = {
    "com": 3,
    "com_velocity": 3,
    "com_acceleration": 3,
    "orientation": 4,
    "angular_velocity": 3,
    "momentum": 3,
    "momentum_rate": 3,
    "radii": 3,
    "radii_rates": 3,
    "radii_accelerations": 3,
    "inertia": 3,
    "force": 3,
    "cop": 2,
    "cop_velocity": 2,
    "moment": 1,
}


def sampler(problem: PlanProblem, phase: int, units: dict[str, float]) -> ca.Function:
    """Return the Function (interval's scaled variables, s in 0..1) -> all quantities in a column.

    Positions, velocities, momenta, radii and forces are exact; the orientation is the collocation
    polynomial's.
    """
    of = problem.schedule[phase]
    constants = (problem.mass, problem.gravity, problem.reference)
    m = motion(units, constants, problem.degree, of.flies, of.intervals)
    s = ca.SX.sym("s")
    at = {
        "com": poly.value(m.com, s),
        "com_velocity": poly.value(m.velocity, s),
        "com_acceleration": poly.value(m.acceleration, s),
        "momentum": poly.value(m.momentum, s),
        "momentum_rate": poly.value(m.torque, s),
        "radii": poly.value(m.radii, s),
        "radii_rates": poly.value(m.rates, s),
        "force": ca.SX.zeros(3),
        "cop": ca.SX.nan(2),
        "cop_velocity": ca.SX.nan(2),
        "moment": ca.SX.zeros(1),
    }
    for name, p in m.controls.items():
        at[name] = poly.value(p, s)
    if "cop" in m.controls:
        at["cop_velocity"] = m.controls["cop"][1] / m.duration
    sigma = poly.value(m.orientation, s)
    squares = at["radii"] ** 2
    at["inertia"] = problem.mass / 3.0 * (ca.sum1(squares) - squares)
    rate = body_rate(sigma, at["momentum"], at["radii"], problem.mass, problem.reference)
    x, y, z, w = problem.reference
    axes = ca.DM(np.array(rotation_rows(x, y, z, w)))
    at["angular_velocity"] = axes @ (rotation_of(sigma) @ rate)
    norm = ca.sumsqr(sigma)
    turned = ca.vertcat(2 * sigma, 1 - norm) / (1 + norm)
    at["orientation"] = quaternion_product(ca.SX([x, y, z, w]), turned)
    column = ca.vertcat(*(ca.densify(at[name]) for name in _SAMPLED))
    return ca.Function("sample", [m.z, s], [column])


def gathered(time: Array, phase: NDArray[np.int64], columns: Array) -> Trajectory:
    """Return the trajectory of samples, one a column of ``columns``."""
    parts, at = {}, 0
    for name, size in _SAMPLED.items():
        part = np.array(columns[at : at + size].T)
        parts[name] = part.ravel() if size == 1 else part
        at += size
    return Trajectory(time=read_only(time), phase=phase, **parts)
