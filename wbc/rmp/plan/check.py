"""Whether a plan is what it claims: equations of motion and limits, looked at anew and finer.

Nothing of the programme is used here but the motion: limits are read from the problem, and each
interval is integrated again, from its left knot, under the plan's ground force, CoP and moment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from wbc.polygon import polygon_margin
from wbc.rmp.frames import rotation_rows
from wbc.rmp.ground import FLIGHT
from wbc.rmp.plan.linear import carried_on
from wbc.rmp.plan.plan import Plan
from wbc.rmp.plan.state import State
from wbc.rmp.plan.trajectory import Trajectory
from wbc.validate import Array

# Largest defect or excess of a plan in order, in the unit of each quantity.
TOLERANCE = 1e-6
# Largest change of the angular momentum in a flight [kg m^2/s].
DRIFT = 1e-8
_CONTROLS = {"force": "N", "cop": "m", "moment": "N m"}
_TIGHT = 1e-12  # of the integration, relative and absolute


@dataclass(frozen=True)
class Excess:
    """How far a limit of a phase is exceeded at the worst moment; negative is room to spare.

    ``time`` [s], ``amount`` in ``unit``.
    """

    phase: str
    quantity: str
    time: float
    amount: float
    unit: str

    def __str__(self) -> str:
        over = f"exceeds its limit by {self.amount:.3g} {self.unit}"
        room = f"keeps {-self.amount:.3g} {self.unit} from its limit"
        return (
            f"{self.phase}: {self.quantity} {over if self.amount > 0.0 else room}"
            f" at {self.time:.3f} s"
        )


@dataclass(frozen=True)
class Check:
    """Verdict on a plan.

    Attributes
    ----------
    defects:
        By state: the largest difference between the plan at a right knot and integration from the
        left one, in SI units (orientation in rad).
    limits:
        The worst moment of each limit in each phase, goal and period, the worst first.
    drift:
        Largest change of k_G within a flight [kg m^2/s]; zero if there is none.
    lost_contact:
        Stances in which the ground is hardly pushed on at some moment.
    """

    defects: dict[str, float]
    limits: tuple[Excess, ...]
    drift: float
    lost_contact: tuple[str, ...]

    @property
    def defect(self) -> float:
        """The largest of all defects."""
        return max(self.defects.values())

    @property
    def violations(self) -> tuple[Excess, ...]:
        """Limits exceeded by more than the tolerance, the worst first."""
        return tuple(each for each in self.limits if each.amount > TOLERANCE)

    @property
    def excess(self) -> float:
        """The largest excess; negative if there is room everywhere."""
        return self.limits[0].amount

    @property
    def ok(self) -> bool:
        """True if dynamics, limits and flights are in order and no contact is lost."""
        in_order = self.defect < TOLERANCE and self.drift < DRIFT
        return in_order and not self.violations and not self.lost_contact

    def report(self) -> str:
        """Return lines for the user."""
        lines = [f"largest defect of the dynamics {self.defect:.2g}, drift of k_G in flight"]
        lines[0] += f" {self.drift:.2g} kg m^2/s"
        lines += [str(each) for each in self.violations] or ["no limit is exceeded"]
        lines += [f"{name}: the ground is hardly pushed on" for name in self.lost_contact]
        return "\n".join(lines)


def check(plan: Plan, factor: int = 2) -> Check:
    """Look at a plan at ``factor`` points an interval, and integrate it again.

    Raises
    ------
    InvalidInputError
        A factor below 1.
    """
    fine = plan.refined(factor)
    excesses = []
    for k in range(len(plan.phases)):
        excesses += _phase_excesses(plan, fine, k)
    excesses += _ends(plan)
    drift, lost = 0.0, []
    for k, phase in enumerate(plan.problem.schedule):
        here = fine.phase == k
        if phase.flies:
            drift = max(drift, float(np.ptp(fine.momentum[here], axis=0).max()))
        elif fine.force[here, 2].min() < FLIGHT * plan.problem.mass * plan.problem.gravity:
            lost.append(phase.name)
    return Check(
        defects=_defects(plan),
        limits=tuple(sorted(excesses, key=lambda each: -each.amount)),
        drift=drift,
        lost_contact=tuple(lost),
    )


def _phase_excesses(plan: Plan, fine: Trajectory, k: int) -> list[Excess]:
    phase, limits = plan.problem.schedule[k], plan.problem.limits_of(k)
    here = fine.phase == k
    time = fine.time[here]
    out: list[Excess] = []

    def most(quantity: str, values: Array, greatest: float | Array, unit: str) -> None:
        over = (values - greatest).reshape(len(time), -1).max(axis=1)
        worst = int(over.argmax())
        if np.isfinite(over[worst]):
            out.append(Excess(phase.name, quantity, float(time[worst]), float(over[worst]), unit))

    def between(quantity: str, values: Array, pair: tuple[float, float], unit: str) -> None:
        most(f"{quantity} (least)", -values, -pair[0], unit)
        most(f"{quantity} (greatest)", values, pair[1], unit)

    between("height", fine.com[here, 2], limits.height, "m")
    between("radius", fine.radii[here], limits.radius, "m")
    most("radius_rate", np.abs(fine.radii_rates[here]), limits.radius_rate, "m/s")
    most(
        "radius_acceleration",
        np.abs(fine.radii_accelerations[here]),
        limits.radius_acceleration,
        "m/s^2",
    )
    most("momentum", np.abs(fine.momentum[here]), limits.momentum, "kg m^2/s")
    lasting = float(plan.durations[k])
    between("duration", np.full(len(time), lasting), phase.durations, "s")
    if phase.support is None:
        return out
    f, cop = fine.force[here], fine.cop[here]
    leg = fine.com[here] - np.column_stack((cop, np.zeros(len(cop))))
    length = np.linalg.norm(leg, axis=1)
    between("leg_length", length, limits.leg_length, "m")
    most("leg_push", -(leg * f).sum(axis=1) / length, 0.0, "N")
    between("normal_force", f[:, 2], limits.normal_force, "N")
    if np.isfinite(limits.friction):
        most("friction", np.hypot(f[:, 0], f[:, 1]), limits.friction * f[:, 2], "N")
    most("torsion", np.abs(fine.moment[here]), limits.torsion * f[:, 2], "N m")
    most("force", np.linalg.norm(f, axis=1), limits.force, "N")
    most("torque", np.linalg.norm(fine.momentum_rate[here], axis=1), limits.torque, "N m")
    most("cop", -polygon_margin(phase.support, cop), 0.0, "m")
    return out


def _ends(plan: Plan) -> list[Excess]:
    """Return how far the goal and the period are missed."""
    problem, knots = plan.problem, plan.knots
    ends = [int(np.flatnonzero(knots.phase == k)[-1]) for k in range(len(plan.phases))]
    units = {"com": "m", "com_velocity": "m/s", "momentum": "kg m^2/s"}
    units |= {"radii": "m", "radii_rates": "m/s", "orientation": "rad"}
    out = []
    for where, k, state in problem.waypoints:
        time = float(plan.starts[k + 1])
        for name, values in state.values(problem.mass).items():
            there = getattr(knots, name)[ends[k]]
            if name == "orientation":
                missed = _missed_turn(problem.reference, state, there)
            else:
                pairs = zip(there.tolist(), values, strict=True)
                missed = max(abs(x - y) for x, y in pairs if y is not None)
            out.append(Excess(where, name, time, missed, units[name]))
    if problem.periodic is not None:
        shift = np.array((*problem.periodic, 0.0))
        for name in ("com", "com_velocity", "momentum", "radii", "radii_rates"):
            series = getattr(knots, name)
            missed = np.abs(series[-1] - series[0] - (shift if name == "com" else 0.0)).max()
            out.append(Excess("period", name, plan.duration, float(missed), units[name]))
        for name in carried_on(problem):
            series = getattr(knots, name)
            missed = np.abs(series[-1] - series[0] - (shift[:2] if name == "cop" else 0.0)).max()
            out.append(Excess("period", name, plan.duration, float(missed), _CONTROLS[name]))
        turned = turn_between(knots.orientation[0], knots.orientation[-1])
        out.append(Excess("period", "orientation", plan.duration, turned, "rad"))
    return out


def _missed_turn(reference: tuple[float, float, float, float], state: State, there: Array) -> float:
    """Return the angle [rad] between an orientation and the one that is given."""
    away = Rotation.from_quat(reference).inv() * Rotation.from_quat(there)
    rotation = state.rotation or ()
    if None in rotation:
        # Where only zeros are given: the part of the turn about those axes.
        vector = away.as_rotvec()
        return max(abs(x) for x, y in zip(vector.tolist(), rotation, strict=True) if y is not None)
    aim = Rotation.from_rotvec(np.array(rotation, dtype=float))
    return turn_between(aim.as_quat(), away.as_quat())


def turn_between(a: Array, b: Array) -> float:
    """Return the angle [rad] between orientations given as unit quaternions."""
    sine = min(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b))) / 2.0
    return 4.0 * math.asin(min(sine, 1.0))


# ------------------------------------------------------------------ integration


def _defects(plan: Plan) -> dict[str, float]:
    knots = plan.knots
    worst = dict.fromkeys(
        ("com", "com_velocity", "orientation", "momentum", "radii", "radii_rates"), 0.0
    )
    for i in np.flatnonzero(np.diff(knots.phase) == 0).tolist():
        end = _integrated(plan, knots, i)
        for name, value in end.items():
            there = getattr(knots, name)[i + 1]
            if name == "orientation":
                away = turn_between(value / np.linalg.norm(value), there)
            else:
                away = float(np.abs(value - there).max())
            worst[name] = max(worst[name], away)
    return worst


def _integrated(plan: Plan, knots: Trajectory, i: int) -> dict[str, Array]:
    """Return the state at knot i + 1, integrated from knot i under linear controls."""
    mass, gravity = plan.problem.mass, plan.problem.gravity
    h = float(knots.time[i + 1] - knots.time[i])
    flies = plan.problem.schedule[int(knots.phase[i])].flies
    f0, f1 = knots.force[i], knots.force[i + 1]
    p0, p1 = ((0.0, 0.0), (0.0, 0.0)) if flies else (knots.cop[i], knots.cop[i + 1])
    m0, m1 = knots.moment[i], knots.moment[i + 1]
    u0, u1 = knots.radii_accelerations[i], knots.radii_accelerations[i + 1]
    pull = np.array((0.0, 0.0, -gravity))

    def rate(t: float, x: Array) -> Array:
        s = t / h
        force = (1.0 - s) * f0 + s * f1
        x0, y0 = ((1.0 - s) * a + s * b for a, b in zip(p0, p1, strict=True))
        q, k, r = x[6:10], x[10:13], x[13:16]
        lever = np.array((x0, y0, 0.0)) - x[:3]
        moment = np.array((0.0, 0.0, (1.0 - s) * m0 + s * m1))
        squares = r * r
        R = np.array(rotation_rows(*(q / np.linalg.norm(q))))
        w = (R.T @ k) / (mass / 3.0 * (squares.sum() - squares))
        spun = np.concatenate((q[3] * w + np.cross(q[:3], w), [-q[:3] @ w])) / 2.0
        return np.concatenate(
            (
                x[3:6],
                force / mass + pull,
                spun,
                np.cross(lever, force) + moment,
                x[16:19],
                (1.0 - s) * u0 + s * u1,
            )
        )

    start = np.concatenate(
        (
            knots.com[i],
            knots.com_velocity[i],
            knots.orientation[i],
            knots.momentum[i],
            knots.radii[i],
            knots.radii_rates[i],
        )
    )
    x = solve_ivp(rate, (0.0, h), start, method="DOP853", rtol=_TIGHT, atol=_TIGHT).y[:, -1]
    return {
        "com": x[:3],
        "com_velocity": x[3:6],
        "orientation": x[6:10],
        "momentum": x[10:13],
        "radii": x[13:16],
        "radii_rates": x[16:19],
    }
