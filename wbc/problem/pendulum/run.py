"""Simulates a pendulum's law, or solves for its plan, and says what came of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from wbc.problem.pendulum.build import Balance, Planning
from wbc.problem.pendulum.from_plan import plan_history
from wbc.problem.pendulum.from_simulation import simulation_history
from wbc.problem.pendulum.history import PendulumHistory
from wbc.problem.pendulum.law_specs import PendulumStopSpec
from wbc.problem.pendulum.result import PendulumResult, PendulumStatus
from wbc.rmp.balance.record import Ending, Simulation
from wbc.rmp.balance.simulate import simulate
from wbc.rmp.balance.spin_change import SpinChange
from wbc.rmp.plan import check, plan_arrays, solve
from wbc.rmp.planar import PlanarRmp
from wbc.run.simulate import Progress
from wbc.validate import Array

_ENDINGS = {
    Ending.COMPLETE: PendulumStatus.COMPLETED,
    Ending.FELL: PendulumStatus.FELL,
    Ending.CONTACT_LOST: PendulumStatus.CONTACT_LOST,
    Ending.LAW_FAILED: PendulumStatus.LAW_FAILED,
    Ending.DIVERGED: PendulumStatus.DIVERGED,
}


def run_balance(
    balance: Balance,
    stop: PendulumStopSpec,
    provenance: Mapping[str, Any],
    progress: Progress | None = None,
) -> PendulumResult:
    """Simulate a law and return what came of it."""
    total = round(stop.duration / stop.dt)

    def told(time: float) -> None:
        if progress is not None:
            progress(min(round(time / stop.dt), total), total, {"time": time})

    simulation = simulate(
        balance.law,
        balance.q,
        balance.v,
        stop.duration,
        dt=stop.dt,
        plant=balance.plant,
        bounds=balance.bounds,
        pushes=balance.pushes,
        pivot=balance.pivot,
        progress=told,
    )
    history = simulation_history(simulation)
    measures = _measures(balance, simulation, history)
    status, reason = _verdict(simulation, stop, measures)
    measures |= {
        f"margin to {name}": room
        for name, room in simulation.margins().items()
        if math.isfinite(room)
    }
    arrays = {"q": simulation.q, "v": simulation.v, "force": simulation.force}
    return PendulumResult(status, reason, measures, history, arrays, provenance)


def _measures(
    balance: Balance, simulation: Simulation, history: PendulumHistory
) -> dict[str, float]:
    leg = history.com - history.foot
    away = np.arctan2(np.linalg.norm(np.cross(leg, balance.goal), axis=1), leg @ balance.goal)
    across = leg[-1] / np.linalg.norm(leg[-1])
    turning = history.com_velocity[-1] - (history.com_velocity[-1] @ across) * across
    wheel = simulation.v[-1, 3:4] if history.flat else simulation.v[-1, 5:8]
    measures = {
        "leg": float(away[-1]),
        "leg_rate": float(np.linalg.norm(turning) / np.linalg.norm(leg[-1])),
        "wheel_rate": float(np.linalg.norm(wheel)),
        "worst_leg": float(away.max()),
    }
    if isinstance(balance.law, SpinChange):
        measures["spin"] = _spin_error(balance.law, simulation.v[-1])
    return measures


def _spin_error(law: SpinChange, v: Array) -> float:
    """Return how far the masses' spin in space (planar) or all of it (solid) is off [rad/s]."""
    if len(v) == len(PlanarRmp.V):
        return abs(float(v[1] + v[3]) - law.spin)
    # A body that tumbles has spin about the other axes too.
    return float(np.linalg.norm(v[5:8] - law.spin * np.eye(3)[law.axis]))


def _verdict(
    simulation: Simulation, stop: PendulumStopSpec, measures: Mapping[str, float]
) -> tuple[PendulumStatus, str]:
    if simulation.ending is not Ending.COMPLETE:
        return _ENDINGS[simulation.ending], simulation.note
    missed = [
        f"{name} ({measures[name]:.3g}, tolerance {tolerance:g})"
        for name, tolerance in stop.accept.model_dump(exclude_none=True).items()
        if not measures[name] <= tolerance
    ]
    broken = [f"{name} by {amount:.3g}" for name, amount in simulation.broken().items()]
    told = [f"stood for {simulation.ended_at:g} s"]
    if missed:
        told.append(f"not within tolerance: {', '.join(missed)}")
    if broken:
        told.append(f"out of bounds: {', '.join(broken)}")
    if simulation.note:
        told.append(f"the law: {simulation.note}")
    good = not missed and not broken
    status = PendulumStatus.COMPLETED if good else PendulumStatus.NOT_REACHED
    return status, "; ".join(told)


def run_plan(planning: Planning, provenance: Mapping[str, Any]) -> PendulumResult:
    """Solve for a plan and return it, checked at twice the knots.

    Raises
    ------
    PlanError
        There is none; the error names what is in the way.
    """
    plan = solve(planning.problem, iterations=planning.iterations)
    checked = check(plan)
    stats = plan.stats
    measures = {
        "variables": float(stats.variables),
        "constraints": float(stats.constraints),
        "iterations": float(stats.iterations),
        "seconds": stats.seconds,
        "duration": plan.duration,
        "largest defect": checked.defect,
        "largest violation": max((each.amount for each in checked.limits), default=-math.inf),
        "momentum drift in flight": checked.drift,
    }
    status = PendulumStatus.PLANNED if checked.ok else PendulumStatus.PLAN_BROKEN
    return PendulumResult(
        status,
        "; ".join(checked.report().splitlines()),
        measures,
        plan_history(plan),
        plan_arrays(plan),
        provenance,
    )
