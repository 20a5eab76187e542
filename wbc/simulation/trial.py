"""A simulation from its start to its end, or to the robot's fall, and what came of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from wbc.controllers import Controller
from wbc.controllers.closed_loop import LoopTick
from wbc.controllers.torque import TorqueController
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import ControllerFailure, InvalidInputError
from wbc.run.conclusion import conclude
from wbc.run.history import Recorder as RunRecorder
from wbc.run.phases import PhaseExecutor
from wbc.run.simulate import PROGRESS_EVERY, Cancelled, Progress, Show, ticks_in
from wbc.run.stopping import Stop
from wbc.simulation.falling import FallLimits, Verdict
from wbc.simulation.loop import STANDING_LIMITS, SimulationTick, simulate
from wbc.simulation.plant import Plant
from wbc.simulation.recorder import Recorder
from wbc.simulation.result import SimulationResult
from wbc.validate import Array


def run_trial(
    phases: PhaseExecutor,
    plant: Plant,
    stop: Stop,
    *,
    falls: FallLimits = STANDING_LIMITS,
    progress: Progress | None = None,
    provenance: Mapping[str, Any] | None = None,
    cancelled: Cancelled | None = None,
    show: Show | None = None,
) -> SimulationResult:
    """Simulate a plant, from the state that it is in, under controllers of torques.

    Parameters
    ----------
    phases:
        Lead the controllers; they remember where they are, so they serve one trial.
    plant:
        With its pushes to come.
    stop:
        Its ``duration``, and what must hold at the end; it does not end at rest.
    falls:
        What counts as a fall, which ends it.
    progress, cancelled, show:
        As of :func:`wbc.run.simulate`; ``failed`` counts the ticks in which something gave way.
    provenance:
        Where it comes from, as plain data; becomes a part of the result.

    Raises
    ------
    InvalidInputError
        A controller of another robot, or one that gives no torques.
    SimulationError
        The physics blew up.
    """
    dt, total = plant.dt, ticks_in(stop.duration, plant.dt)
    truth, run = Recorder(plant), RunRecorder(plant.robot, phases.tasks)
    up = plant.body_rotation(falls.trunk)[2].copy()  # the vertical in the trunk's axes
    verdict, interrupted = Verdict(True, plant.time, "stood for 0 s"), None
    pushes = tuple(plant.pushes)
    gave_way = Counter[str]()
    relaxed = lost = 0
    tilt = [0.0]
    first = phases.controller

    loop = simulate(first, plant, total * dt, update=phases.update, falls=falls)
    try:
        for now in loop:
            truth.add(now.tick)
            kept = _as_run(now, dt)
            run.add(kept, phases.standing)
            gave_way.update(now.tick.relaxed)
            relaxed += bool(now.tick.policy)
            lost += not now.fresh
            verdict = now.verdict
            tilt.append(_angle(plant.body_rotation(falls.trunk)[2], up))
            if show is not None:
                show(kept, phases.controller)
            done = len(run.states)
            over = not verdict.stood or done == total
            if not over and cancelled is not None and cancelled():
                over, interrupted = True, plant.time
            if progress is not None and ((done - 1) % PROGRESS_EVERY == 0 or over):
                progress(done, total, {"time": plant.time, "errors": {}, "failed": relaxed})
            if over:
                break
    except ControllerFailure as failure:
        if not isinstance(failure.tick, TorqueTick) or not run.states:
            raise
        run.failures[len(run.states)] = failure.tick.report()
    if not run.states:
        raise InvalidInputError("simulation: the sensors lost every frame; there was no tick")
    phases.move_to(plant.time)
    result = conclude(
        phases.tasks,
        stop,
        run,
        phases.standing,
        plant.snapshot(),
        False,
        phases.complaint,
        provenance,
        interrupted,
    )
    return SimulationResult.of(
        result,
        plant,
        truth,
        verdict=verdict,
        pushes=pushes,
        gave_way=gave_way,
        relaxed=relaxed,
        lost=lost,
        tilt=np.array(tilt),
        bounds=_bounds(first),
    )


def _as_run(now: SimulationTick, dt: float) -> LoopTick:
    """Return a control period as the run's recorder knows it: by when it began."""
    began = now.time - dt
    return LoopTick(
        began, now.snapshot, now.tick, now.snapshot.q, now.seconds, now.cpu_seconds, False
    )


def _angle(a: Array, b: Array) -> float:
    """Return the angle between unit vectors [rad]."""
    return float(np.arccos(np.clip(a @ b, -1.0, 1.0)))


def _bounds(controller: Controller) -> Array:
    """Return the bounds (nv - 6,) that torques really have: the controller's and the motors'."""
    effort = controller.robot.limits.effort
    if not isinstance(controller, TorqueController):
        return effort
    return np.minimum(controller.torque_bounds, effort)
