"""A simulation from its start to its end, or to the robot's fall, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from wbc.controllers import Controller
from wbc.controllers.torque import TorqueController
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import ControllerFailure, InvalidInputError
from wbc.run.callbacks import Callbacks, Cancelled, Progress, Show
from wbc.run.conclusion import conclude
from wbc.run.simulate import ticks_in
from wbc.run.stopping import Stop
from wbc.run.supervisor import Supervisor
from wbc.simulation.falling import FallLimits
from wbc.simulation.loop import STANDING_LIMITS, simulate
from wbc.simulation.plant import Plant
from wbc.simulation.result import SimulationResult
from wbc.simulation.trial_record import TrialRecord
from wbc.tracking.deviation import Followed
from wbc.validate import Array


def run_trial(
    phases: Supervisor,
    plant: Plant,
    stop: Stop,
    *,
    falls: FallLimits = STANDING_LIMITS,
    plan: Followed | None = None,
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
    plan:
        What the tasks follow, by which the result is judged too.
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
    calls = Callbacks(progress, cancelled=cancelled, show=show)
    total = ticks_in(stop.duration, plant.dt)
    record = TrialRecord(plant, phases)
    first = phases.controller
    loop = simulate(first, plant, total * plant.dt, update=phases.update, falls=falls)
    try:
        for now in loop:
            kept = record.add(now)
            calls.tick(kept, phases.controller)
            over = not now.verdict.stood or record.ticks == total
            if calls.should_end(plant.time, record.ticks, total, over, record.info):
                break
    except ControllerFailure as failure:
        if not isinstance(failure.tick, TorqueTick) or not record.ticks:
            raise
        record.run.failures[record.ticks] = failure.tick.report()
    if not record.ticks:
        raise InvalidInputError("simulation: the sensors lost every frame; there was no tick")
    phases.move_to(plant.time)
    result = conclude(
        phases.tasks,
        stop,
        record.run,
        phases.standing,
        plant.snapshot(),
        False,
        phases.complaint,
        provenance,
        calls.interrupted,
    )
    return SimulationResult.of(result, plant, record, _bounds(first), plan)


def _bounds(controller: Controller) -> Array:
    """Return the bounds (nv - 6,) that torques really have: the controller's and the motors'."""
    effort = controller.robot.limits.effort
    if not isinstance(controller, TorqueController):
        return effort
    return np.minimum(controller.torque_bounds, effort)
