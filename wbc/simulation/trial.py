"""A simulation from its start to its end, or to the robot's fall, and its result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from wbc.controllers import Controller
from wbc.controllers.torque import TorqueController
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import ControllerFailure, InvalidInputError
from wbc.run.conclusion import conclude
from wbc.run.simulate import Callbacks, Cancelled, Progress, Show, ticks_in
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
    """Simulate a plant, from its present state, under torque controllers.

    Parameters
    ----------
    phases:
        Supervise the controllers; they have a state and serve one trial.
    plant:
        With its future pushes.
    stop:
        Its ``duration`` and conditions; it does not end at rest.
    falls:
        Criteria of a fall, which ends it.
    plan:
        Followed by the tasks; the result has its tracking errors.
    progress, cancelled, show:
        See :func:`wbc.run.simulate`; ``relaxed`` counts the ticks in which something gave way.
    provenance:
        Origin of the run, as plain data; a part of the result.

    Raises
    ------
    InvalidInputError
        A controller of another robot, or one that gives no torques.
    SimulationError
        The physics blew up.
    UnknownNameError
        The stop criteria accept a task that there is not.
    """
    stop.check_tasks(phases.tasks)
    calls = Callbacks(progress, cancelled=cancelled, show=show)
    first = phases.controller
    total = ticks_in(stop.duration, first.dt)
    record = TrialRecord(plant, phases)
    loop = simulate(first, plant, total * first.dt, update=phases.update, falls=falls)
    try:
        for now in loop:
            loop_tick = record.add(now)
            calls.tick(loop_tick, phases.controller)
            done = not now.verdict.stood or record.ticks == total
            if calls.should_end(plant.time, record.ticks, total, done, record.info):
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
    return SimulationResult.of(result, plant, record, _torque_bounds(first), plan)


def _torque_bounds(controller: Controller) -> Array:
    """Return the bounds (nv - 6,) on torques: the tighter of the controller's and the motors'."""
    effort = controller.robot.limits.effort
    if not isinstance(controller, TorqueController):
        return effort
    return np.minimum(controller.torque_bounds, effort)
