"""The closed loop in physics: measure, command a torque, step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from time import perf_counter, thread_time
from typing import NamedTuple

from wbc.controllers.closed_loop import Update, check_period, ticks_of
from wbc.controllers.controller import Controller
from wbc.controllers.torque import TorqueController
from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import InvalidInputError, shown
from wbc.kinds import check_callable, check_kind
from wbc.robot import Snapshot
from wbc.simulation.falling import FallLimits, FallWatch, Verdict
from wbc.simulation.plant import Plant
from wbc.validate import Array, finite_number

STANDING_LIMITS = FallLimits()


class SimulationTick(NamedTuple):
    """One control period of a simulation, at its end.

    Attributes
    ----------
    time:
        Simulated time at its end [s], the plant's time now.
    snapshot:
        The state measured at its beginning; for a lost frame the last one.
    state:
        The true state at its beginning: configuration (nq,) and velocity (nv,).
    tick:
        The controller's answer, given to the plant.
    fresh:
        Whether the frame was measured; if not, the last torque was held.
    verdict:
        Whether the robot stands at its end.
    seconds, cpu_seconds:
        From measurement to command, by the clock and of this thread's CPU.
    """

    time: float
    snapshot: Snapshot
    state: tuple[Array, Array]
    tick: TorqueTick
    fresh: bool
    verdict: Verdict
    seconds: float
    cpu_seconds: float


def simulate(
    controller: Controller,
    plant: Plant,
    duration: float,
    *,
    update: Update | None = None,
    falls: FallLimits | None = STANDING_LIMITS,
) -> Iterator[SimulationTick]:
    """Yield the control periods of a plant, from its present state.

    It ends after ``duration``, after the period in which the robot fell, or when ``update`` returns
    None. Between periods the caller may move targets, push the robot or record the plant
    (:class:`~wbc.simulation.recorder.Recorder`). Controllers get the known wrenches of
    :meth:`Plant.apply <wbc.simulation.Plant.apply>`. When the sensors lose a frame, the last torque
    is held; before the first frame it is zero.

    Parameters
    ----------
    controller:
        With the period, and torques: a :class:`~wbc.controllers.torque.TorqueController`.
    duration:
        [s]; the last period is whole.
    update:
        Called before each command with the period's number and the measured state; returns the
        controller of this period, or None to end.
    falls:
        Criteria of a fall, which ends it; None: it does not.

    Raises
    ------
    InvalidInputError
        A controller of another robot, one that gives no torques, that takes no wrenches where
        there are known ones, or whose period is no multiple of the physics' step.
    SimulationError
        The physics blew up.
    ControllerFailure
        By the controller's policy ``raise``.
    """
    _check_controller("simulate, controller", controller)
    check_kind("simulate, plant", plant, Plant, "Plant(robot)")
    check_callable("simulate, update", update, "(period, snapshot)")
    check_kind("simulate, falls", falls, FallLimits, "FallLimits()", or_none=True)
    if controller.robot is not plant.robot:
        raise InvalidInputError(
            f"simulate: the controller's robot {controller.robot!r} and the plant's"
            f" {plant.robot!r} must be the same object; for errors of the model see ModelMismatch"
        )
    dt = controller.dt
    total = ticks_of(finite_number("simulate, duration", duration, above=0.0), dt)
    watch = FallWatch(plant, falls or STANDING_LIMITS)
    tick: TorqueTick | None = None
    snapshot: Snapshot | None = None
    for k in range(total):
        started, cpu_started = perf_counter(), thread_time()
        measured = plant.measure()
        if measured is not None:
            snapshot = plant.robot.snapshot(*measured)
            active = controller if update is None else update(k, snapshot)
            if active is None:
                return
            _check_controller("simulate, what update returned", active)
            check_period(active, dt)
            tick = _torque_tick(active, snapshot, plant.known_wrenches(dt))
        if snapshot is None or tick is None:  # before the first frame
            plant.step(plant.torque, dt)
            continue
        seconds, cpu_seconds = perf_counter() - started, thread_time() - cpu_started
        state, fresh = plant.state(), measured is not None
        plant.step(tick.torque, dt)
        verdict = watch.verdict()
        yield SimulationTick(
            plant.time, snapshot, state, tick, fresh, verdict, seconds, cpu_seconds
        )
        if falls is not None and not verdict.stood:
            return


def _torque_tick(
    controller: Controller, snapshot: Snapshot, wrenches: Mapping[str, Array]
) -> TorqueTick:
    if isinstance(controller, TorqueController):
        return controller.step(snapshot, wrenches)
    if wrenches:  # left out, whatever carries them sags
        raise InvalidInputError(
            f"simulate: a {type(controller).__name__} takes no known wrenches, and one acts on"
            f" {', '.join(wrenches)}: plant.apply(..., told=False), or give a TorqueController, of"
            " a walker walker.controller and update=lambda _, now: walker.prepare(now)"
        )
    tick = controller.step(snapshot)
    if not isinstance(tick, TorqueTick):
        raise InvalidInputError(
            f"simulate: a {type(controller).__name__} commands no torques; use a TorqueController"
        )
    return tick


def _check_controller(what: str, controller: object) -> None:
    """Refuse objects without a controller's methods; user-defined ones may be of any class."""
    if not all(hasattr(controller, name) for name in ("robot", "dt", "step")):
        raise InvalidInputError(
            f"{what}: expected a controller, such as TorqueController(robot, tasks), got"
            f" {shown(controller)}"
        )
