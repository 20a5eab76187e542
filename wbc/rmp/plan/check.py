"""Verification of a plan: dynamics and limits, independently of the programme and on a finer grid.

Only the motion is taken from the programme: limits are read from the problem, and each interval is
integrated again, from its left knot, under the plan's ground force, CoP and moment.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from wbc.kinds import check_kind
from wbc.polygon import polygon_margin
from wbc.rmp.ground import FLIGHT
from wbc.rmp.plan.plan import Plan, Trajectory
from wbc.rmp.plan.schedule import STATE, State
from wbc.rotations import rotation_from
from wbc.validate import Array

# Largest defect or excess accepted, in the unit of each quantity.
TOLERANCE = 1e-6
# Largest change of the angular momentum in a flight [kg m^2/s].
DRIFT = 1e-8
UNITS = {  # of states, goals and limits, by name
    "com": "m",
    "com_velocity": "m/s",
    "orientation": "rad",
    "momentum": "kg m^2/s",
    "radii": "m",
    "radii_rates": "m/s",
    "force": "N",
    "cop": "m",
    "moment": "N m",
}
_TIGHT = 1e-12  # of the integration, relative and absolute
_MOST_RATES = 20_000  # evaluations in an interval; sound plans take some hundreds


class _TooStiff(Exception):
    """The integration of an interval takes too many steps."""


@dataclass(frozen=True)
class Excess:
    """Largest excess over a limit in a phase; negative is a margin."""

    phase: str
    quantity: str
    time: float  # [s]
    amount: float
    unit: str

    def __str__(self) -> str:
        verdict = f"keeps {-self.amount:.3g} {self.unit} from its limit"
        if self.amount > 0.0:
            verdict = f"exceeds its limit by {self.amount:.3g} {self.unit}"
        return f"{self.phase}: {self.quantity} {verdict} at {self.time:.3f} s"


@dataclass(frozen=True)
class Check:
    """The result of checking a plan.

    The defect of a state is the largest difference between the plan at a right knot and integration
    from the left one.
    """

    defects: dict[str, float]  # by state, in UNITS
    limits: tuple[Excess, ...]  # worst moment of each in each phase, goal, period; the worst first
    drift: float  # largest change of k_G within a flight [kg m^2/s]; zero if there is none
    lost_contact: tuple[str, ...]  # stances with hardly any ground force at some time

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
        """The largest excess; negative if every limit is kept with a margin."""
        return self.limits[0].amount

    @property
    def ok(self) -> bool:
        """True if dynamics and limits are met to the tolerances and no contact is lost."""
        met = self.defect < TOLERANCE and self.drift < DRIFT
        return met and not self.violations and not self.lost_contact

    def report(self) -> str:
        """Return a report in lines of text."""
        drift = f"drift of k_G in flight {self.drift:.2g} kg m^2/s"
        lines = [f"largest defect of the dynamics {self.defect:.2g}, {drift}"]
        lines += [str(each) for each in self.violations] or ["no limit is exceeded"]
        lines += [f"{name}: the ground is hardly pushed on" for name in self.lost_contact]
        return "\n".join(lines)


def check(plan: Plan, factor: int = 2) -> Check:
    """Evaluate a plan at ``factor`` points per interval, and integrate it again.

    Raises
    ------
    InvalidInputError
        A factor below 1.
    """
    check_kind("check: plan", plan, Plan)
    fine = plan.refined(factor)
    excesses = _ends(plan)
    drift, lost = 0.0, []
    for k, phase in enumerate(plan.problem.schedule):
        excesses += _phase_excesses(plan, fine, k)
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

    def at_most(quantity: str, values: Array, greatest: float | Array, unit: str) -> None:
        over = (values - greatest).reshape(len(time), -1).max(axis=1)
        worst = int(over.argmax())
        if np.isfinite(over[worst]):
            out.append(Excess(phase.name, quantity, float(time[worst]), float(over[worst]), unit))

    def within_range(quantity: str, values: Array, pair: tuple[float, float], unit: str) -> None:
        at_most(f"{quantity} (least)", -values, -pair[0], unit)
        at_most(f"{quantity} (greatest)", values, pair[1], unit)

    within_range("height", fine.com[here, 2], limits.height, "m")
    within_range("radius", fine.radii[here], limits.radius, "m")
    at_most("radius_rate", np.abs(fine.radii_rates[here]), limits.radius_rate, "m/s")
    outward = np.abs(fine.radii_accelerations[here])
    at_most("radius_acceleration", outward, limits.radius_acceleration, "m/s^2")
    at_most("momentum", np.abs(fine.momentum[here]), limits.momentum, "kg m^2/s")
    duration = np.full(len(time), plan.durations[k])
    within_range("duration", duration, phase.durations, "s")
    if phase.support is None:
        return out
    f, cop = fine.force[here], fine.cop[here]
    leg = fine.com[here] - np.column_stack((cop, np.zeros(len(cop))))
    length = np.linalg.norm(leg, axis=1)
    within_range("leg_length", length, limits.leg_length, "m")
    at_most("leg_push", -(leg * f).sum(axis=1) / length, 0.0, "N")
    within_range("normal_force", f[:, 2], limits.normal_force, "N")
    if np.isfinite(limits.friction):
        at_most("friction", np.hypot(f[:, 0], f[:, 1]), limits.friction * f[:, 2], "N")
    at_most("torsion", np.abs(fine.moment[here]), limits.torsion * f[:, 2], "N m")
    at_most("force", np.linalg.norm(f, axis=1), limits.force, "N")
    at_most("torque", np.linalg.norm(fine.momentum_rate[here], axis=1), limits.torque, "N m")
    at_most("cop", -polygon_margin(phase.support, cop), 0.0, "m")
    return out


def _ends(plan: Plan) -> list[Excess]:
    problem, knots = plan.problem, plan.knots
    out = []
    for where, k, state in problem.waypoints:
        end, time = np.flatnonzero(knots.phase == k)[-1], float(plan.starts[k + 1])
        for name, values in state.values(problem.mass).items():
            there = getattr(knots, name)[end]
            if name == "orientation":
                missed = _missed_angle(problem.reference, state, there)
            else:
                missed = float(np.nanmax(np.abs(there - values), initial=0.0))
            out.append(Excess(where, name, time, missed, UNITS[name]))
    for name, change in problem.period.items():
        first, last = getattr(knots, name)[0], getattr(knots, name)[-1]
        if name == "orientation":
            missed = angle_between(first, last)
        else:
            missed = float(np.abs(last - first - change[: np.size(first)]).max())
        out.append(Excess("period", name, plan.duration, missed, UNITS[name]))
    return out


def _missed_angle(reference: Sequence[float], state: State, there: Array) -> float:
    """Return the angle [rad] between an orientation and the given one."""
    away = Rotation.from_quat(reference).inv() * Rotation.from_quat(there)
    rotation = state.rotation or ()
    if None in rotation:
        # Where only zeros are given: the part of the turn about those axes.
        given = [each is not None for each in rotation]
        return float(np.abs(away.as_rotvec()[given]).max(initial=0.0))
    aim = Rotation.from_rotvec(np.array(rotation, dtype=float))
    return angle_between(aim.as_quat(), away.as_quat())


def angle_between(a: Array, b: Array) -> float:
    """Return the angle [rad] between orientations given as unit quaternions."""
    sine = min(float(np.linalg.norm(a - b)), float(np.linalg.norm(a + b))) / 2.0
    return 4.0 * math.asin(min(sine, 1.0))


# ------------------------------------------------------------------ integration


def _defects(plan: Plan) -> dict[str, float]:
    knots = plan.knots
    worst = dict.fromkeys(STATE, 0.0)
    for i in np.flatnonzero(np.diff(knots.phase) == 0).tolist():
        integrated = _integrated(plan, i)
        if integrated is None:
            return dict.fromkeys(STATE, math.inf)
        for name, value in integrated.items():
            there = getattr(knots, name)[i + 1]
            if name == "orientation":
                away = angle_between(value / np.linalg.norm(value), there)
            else:
                away = float(np.abs(value - there).max())
            worst[name] = max(worst[name], away)
    return worst


def _integrated(plan: Plan, i: int) -> dict[str, Array] | None:
    """Return the state at knot i + 1, integrated from knot i under linear controls.

    None if that takes too many steps: absurd forces make the motion too stiff.
    """
    knots, mass = plan.knots, plan.problem.mass
    h = float(knots.time[i + 1] - knots.time[i])
    force, cop, moment, acceleration = (
        np.nan_to_num(getattr(knots, name)[i : i + 2])  # there is no CoP in flight
        for name in ("force", "cop", "moment", "radii_accelerations")
    )
    gravity, asked = np.array((0.0, 0.0, -plan.problem.gravity)), 0

    def rate(t: float, x: Array) -> Array:
        nonlocal asked
        asked += 1
        if asked > _MOST_RATES:
            raise _TooStiff
        share = np.array((1.0 - t / h, t / h))
        f = share @ force
        q, k, r = x[6:10], x[10:13], x[13:16]
        lever = np.array((*(share @ cop), 0.0)) - x[:3]
        squares = r * r
        R = rotation_from(q / np.linalg.norm(q))
        w = (R.T @ k) / (mass / 3.0 * (squares.sum() - squares))
        q_rate = np.concatenate((q[3] * w + np.cross(q[:3], w), [-q[:3] @ w])) / 2.0
        k_rate = np.cross(lever, f) + (0.0, 0.0, share @ moment)
        c_rate = f / mass + gravity
        return np.concatenate((x[3:6], c_rate, q_rate, k_rate, x[16:19], share @ acceleration))

    start = [getattr(knots, name)[i] for name in STATE]
    ends = np.cumsum([part.size for part in start])
    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            done = solve_ivp(
                rate, (0.0, h), np.concatenate(start), method="DOP853", rtol=_TIGHT, atol=_TIGHT
            )
    except (_TooStiff, ArithmeticError, ValueError):
        return None
    if not done.success:
        return None
    return dict(zip(STATE, np.split(done.y[:, -1], ends[:-1]), strict=True))
