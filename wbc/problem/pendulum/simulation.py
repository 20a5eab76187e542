"""Simulation of a pendulum under a balance law, its measures and its status."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.problem.mistakes import Mistakes
from wbc.problem.pendulum.laws import LawChoice, LawSpec, Setting
from wbc.problem.pendulum.result import PendulumHistory, PendulumResult, PendulumStatus, Support
from wbc.problem.pendulum.spec import PendulumSpec, PendulumStopSpec
from wbc.rmp.balance.foot import require_support
from wbc.rmp.balance.law import BalanceLaw, LawBounds, Pendulum
from wbc.rmp.balance.record import Ending, Simulation
from wbc.rmp.balance.simulate import Blow, impulses_by_step, simulate, whole_steps
from wbc.rmp.ground import centroidal_moment_pivot
from wbc.rmp.planar import PlanarRmp
from wbc.rotations import rotations_from
from wbc.run.simulate import Cancelled, Progress
from wbc.validate import Array

# The phase of a run that ended before its first step.
NOT_STARTED = "start"


@dataclass(frozen=True, eq=False)
class Balance:
    """A law, and the pendulum and pushes to simulate it with."""

    spec: LawSpec  # the law's description
    law: BalanceLaw
    setting: Setting
    plant: Pendulum  # the pendulum that moves
    pushes: tuple[Blow, ...]
    stop: PendulumStopSpec

    def run(
        self,
        provenance: Mapping[str, Any],
        progress: Progress | None = None,
        cancelled: Cancelled | None = None,
    ) -> PendulumResult:
        """Simulate the law and return the result; ``cancelled`` is called before each step."""
        on, stop = self.setting, self.stop
        total = round(stop.duration / stop.dt)

        def tell(time: float) -> None:
            if progress is not None:
                progress(min(round(time / stop.dt), total), total, {"time": time})

        simulation = simulate(
            self.law,
            on.q,
            on.v,
            stop.duration,
            dt=stop.dt,
            plant=self.plant,
            bounds=on.bounds,
            pushes=self.pushes,
            pivot=self.spec.pivot,
            stop=None if cancelled is None else lambda *_: cancelled(),
            progress=tell,
        )
        history = simulation_history(simulation)
        measures = _measures(history, simulation.v[-1], self.spec.leg(on))
        measures |= self.spec.measures(self.law, simulation.v[-1])
        status, reason = _verdict(simulation, stop, measures)
        if simulation.ending is Ending.COMPLETE and len(history.time) <= total:
            status = PendulumStatus.INTERRUPTED
            reason = f"at {history.time[-1]:.4g} s of {stop.duration:g} s"
        measures |= {
            f"margin to {name}": room
            for name, room in simulation.margins().items()
            if math.isfinite(room)
        }
        arrays = {"q": simulation.q, "v": simulation.v, "force": simulation.force}
        return PendulumResult(status, reason, measures, history, arrays, provenance)


def build_balance(
    spec: PendulumSpec, law_spec: LawChoice, pendulum: Pendulum, mistakes: Mistakes
) -> Balance:
    """Return the simulation that a spec describes.

    Raises ProblemFileError: with every mistake found.
    """
    if spec.start is None:
        mistakes.fail((), "a law needs a start, such as start: {leg_length: 0.7, radii: 0.2}")
    q, v = mistakes.require(("start",), partial(spec.start.state, pendulum))
    with mistakes.at("start"):
        # Refuses a leg or masses that cannot move.
        pendulum.forward_dynamics(q, v, np.zeros(len(pendulum.F)))
    bounds = mistakes.require(("bounds",), lambda: LawBounds(**spec.bounds))
    mistakes.require(("bounds",), partial(require_support, pendulum, bounds))
    setting = Setting(pendulum, bounds, q, v, spec.stop.dt)
    if law_spec.needs not in (None, spec.model):
        kind = str(law_spec.needs).removeprefix("rmp_")
        text = f"{law_spec.type} needs a {kind} pendulum; model: {law_spec.needs}"
        mistakes.fail(("law", "type"), text)
    for key in ("polygon", "cop_margin", "friction", "leg_force") if law_spec.pivot else ():
        if key in spec.bounds:
            text = f"a {law_spec.type} has its foot bolted to a pivot; leave this out"
            mistakes.note(("bounds", key), text)
    law: BalanceLaw = mistakes.require(("law",), lambda: law_spec.build(setting))
    stop, accept = spec.stop, spec.stop.accept
    if accept.spin is not None and "spin" not in law_spec.measures(law, v):
        mistakes.note(("stop", "accept", "spin"), "only a law of type spin has this")
    steps = mistakes.require(("stop",), partial(whole_steps, stop.duration, stop.dt))
    pushes = list[Blow]()
    for k, push in enumerate(spec.pushes):
        with mistakes.at("pushes", k):
            pushes.append(Blow(push.time, push.impulse))
            impulses_by_step(pushes[-1:], pendulum, stop.dt, steps)
    mistakes.raise_any()
    plant = type(pendulum)(pendulum.mass * spec.plant.mass, spec.gravity)
    return Balance(law_spec, law, setting, plant, tuple(pushes), stop)


def _measures(history: PendulumHistory, v: Array, goal: Array) -> dict[str, float]:
    leg = history.com - history.foot
    away = np.arctan2(np.linalg.norm(np.cross(leg, goal), axis=1), leg @ goal)
    along = leg[-1] / np.linalg.norm(leg[-1])
    across = history.com_velocity[-1] - (history.com_velocity[-1] @ along) * along
    wheel = v[3:4] if history.flat else v[5:8]
    return {
        "leg": float(away[-1]),
        "leg_rate": float(np.linalg.norm(across) / np.linalg.norm(leg[-1])),
        "wheel_rate": float(np.linalg.norm(wheel)),
        "worst_leg": float(away.max()),
    }


def _verdict(
    simulation: Simulation, stop: PendulumStopSpec, measures: Mapping[str, float]
) -> tuple[PendulumStatus, str]:
    if simulation.ending is not Ending.COMPLETE:
        return PendulumStatus[simulation.ending.name], simulation.note
    missed = [
        f"{name} ({measures[name]:.3g}, tolerance {tolerance:g})"
        for name, tolerance in stop.accept.model_dump(exclude_none=True).items()
        if not measures[name] <= tolerance
    ]
    broken = [f"{name} by {amount:.3g}" for name, amount in simulation.broken().items()]
    said = [f"stood for {simulation.ended_at:g} s"]
    if missed:
        said.append(f"not within tolerance: {', '.join(missed)}")
    if broken:
        said.append(f"out of bounds: {', '.join(broken)}")
    if simulation.note:
        said.append(f"the law: {simulation.note}")
    good = not missed and not broken
    status = PendulumStatus.COMPLETED if good else PendulumStatus.NOT_REACHED
    return status, "; ".join(said)


def simulation_history(simulation: Simulation) -> PendulumHistory:
    """Return a simulation's motion in space, including its first and last state."""
    n = len(simulation.time)
    flat = isinstance(simulation.model, PlanarRmp)
    q, momentum = simulation.q, simulation.momentum()
    com, velocity = (_in_space(each) for each in simulation.com())
    force = _in_space(simulation.ground_force)
    # One for each step, at its beginning; the last state has none.
    pushed = np.flatnonzero(~np.isnan(simulation.cop[:, 0]))
    cop, cmp = np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    cop[pushed] = 0.0
    cop[pushed, : simulation.cop.shape[1]] = simulation.cop[pushed]
    cmp[pushed] = centroidal_moment_pivot(com[pushed], force[pushed])
    foot = np.zeros((n, 3))
    foot[:, : 1 if flat else 2] = q[:, : 1 if flat else 2]
    # A planar pendulum turns about -y, which turns x to z.
    about = np.array((0.0, -1.0, 0.0))
    turn = Rotation.from_rotvec(np.outer(q[:, 1] + q[:, 3], about)).as_matrix() if flat else None
    return PendulumHistory(
        flat=flat,
        time=simulation.time,
        phase=(*simulation.phase, simulation.phase[-1] if simulation.phase else NOT_STARTED),
        com=com,
        com_velocity=velocity,
        foot=foot,
        cop=cop,
        cmp=cmp,
        radii=np.column_stack((q[:, 4], np.zeros((n, 2)))) if flat else q[:, 9:12],
        axes=rotations_from(q[:, 5:9]) if turn is None else turn,
        momentum=np.outer(momentum[:, 0], about) if flat else momentum,
        supports=_supports(simulation),
    )


def _in_space(points: Array) -> Array:
    """Return (n, 3) points of a plane (n, 2), (x, z), or of space as they are."""
    if points.shape[1] == 3:
        return points
    return np.column_stack((points[:, 0], np.zeros(len(points)), points[:, 1]))


def _supports(simulation: Simulation) -> tuple[Support, ...]:
    polygon = simulation.bounds.polygon
    if polygon is None:
        return ()
    corners = np.asarray(polygon)
    if corners.ndim == 1:
        corners = np.column_stack((corners, np.zeros(2)))
    return (Support(float(simulation.time[0]), float(simulation.time[-1]), corners),)
