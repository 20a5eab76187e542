"""Runs a controller, or phases, in a closed loop from a start, and returns the result."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from numpy.typing import ArrayLike

from wbc.controllers import Controller
from wbc.controllers.closed_loop import closed_loop, ticks_of
from wbc.run.callbacks import Callbacks, Cancelled, Observe, Progress, Show, progress_info
from wbc.run.conclusion import conclude
from wbc.run.history import HistoryRecorder
from wbc.run.phases import PhaseExecutor
from wbc.run.result import Result
from wbc.run.stopping import RestDetector, Stop

DEFAULT_STOP = Stop()


def simulate(
    controller: Controller | PhaseExecutor,
    q: ArrayLike,
    stop: Stop = DEFAULT_STOP,
    progress: Progress | None = None,
    observe: Observe | None = None,
    provenance: Mapping[str, Any] | None = None,
    cancelled: Cancelled | None = None,
    show: Show | None = None,
) -> Result:
    """Run from rest at ``q`` (nq,) until the robot is at rest, out of time, or has failed.

    The robot moves exactly as commanded: each tick's velocity is integrated over one time step.

    Parameters
    ----------
    controller:
        One controller, or phases, which have a state and serve one run.
    progress:
        Called every ten ticks and at the end with ticks done, ticks at most, and a mapping with
        ``time`` [s], ``speed`` (largest velocity), ``errors`` (norm by task) and ``failed`` (ticks
        without solution).
    observe:
        Called with every tick: its QP, solution and errors.
    provenance:
        Origin of the run, as plain data; a part of the result.
    cancelled:
        Called after every tick; True ends the run there, with the result so far.
    show:
        Called with every tick of the loop, with its state and controller: for live views.

    Raises
    ------
    InvalidInputError
        An unusable configuration.
    UnknownNameError
        The stop criteria accept a task that there is not.
    """
    if not isinstance(controller, PhaseExecutor):
        controller = PhaseExecutor.single(controller, controller.robot.snapshot(q))
    phases, calls = controller, Callbacks(progress, observe, cancelled, show)
    stop.check_tasks(phases.tasks)
    first = phases.controller
    robot, dt = first.robot, first.dt
    total = ticks_in(stop.duration, dt)
    recorder = HistoryRecorder(robot, phases.tasks)
    rest = RestDetector(stop.speed, phases.ramps_end)
    at_rest = False
    for now in closed_loop(first, q, total, phases.update):
        recorder.add(now, phases.standing)
        calls.tick(now, phases.controller)
        at_rest = rest.at_rest(now.time, now.speed, now.tick.ok)
        done = len(recorder.states)
        over = at_rest or now.gave_up or done == total
        info = partial(progress_info, now, now.tick.errors, len(recorder.failures))
        if calls.should_end(done * dt, done, total, over, info):
            break
    phases.move_to(done * dt)
    end = robot.snapshot(now.q, now.tick.velocity)
    return conclude(
        phases.tasks,
        stop,
        recorder,
        phases.standing,
        end,
        at_rest,
        phases.complaint,
        provenance,
        calls.interrupted,
    )


def ticks_in(duration: float, dt: float) -> int:
    """Return how many ticks of ``dt`` [s] a run of ``duration`` [s] has, at least one."""
    return max(1, ticks_of(duration, dt))
