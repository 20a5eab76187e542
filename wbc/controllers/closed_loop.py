"""The closed kinematic loop: measure, command, integrate."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from time import perf_counter, thread_time
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wbc.controllers.controller import Controller
from wbc.controllers.tick import Tick
from wbc.errors import ControllerFailure, InvalidInputError
from wbc.robot import Snapshot
from wbc.validate import Array

# Called before each tick with its number and the state; returns the controller in charge, or None
# to end the loop.
Update = Callable[[int, Snapshot], Controller | None]
# Part of a tick that is none: 0.035 s are 7 ticks of 0.005 s, though 0.035 / 0.005 is above 7.
ROUNDING = 1e-9


class LoopTick(NamedTuple):
    """One tick of a closed loop.

    Attributes
    ----------
    time:
        When it began [s].
    snapshot:
        The state then.
    tick:
        What the controller answered.
    q:
        (nq,) configuration at the end of the tick.
    seconds, cpu_seconds:
        From measurement to command, by the clock and of this thread's CPU.
    gave_up:
        Whether the controller ended the loop by its policy ``raise``.
    """

    time: float
    snapshot: Snapshot
    tick: Tick
    q: Array
    seconds: float
    cpu_seconds: float
    gave_up: bool

    @property
    def speed(self) -> float:
        """Largest absolute velocity that is commanded [rad/s or m/s]."""
        return float(np.abs(self.tick.velocity).max())


def ticks_of(duration: float, dt: float) -> int:
    """Return how many ticks of ``dt`` [s] last at least as long as ``duration`` [s]."""
    return math.ceil(duration / dt - ROUNDING)


def check_period(controller: Controller, dt: float) -> None:
    """Raise InvalidInputError for a controller whose time step is not a loop's [s]."""
    if controller.dt != dt:
        raise InvalidInputError(
            f"closed loop: ticks last {dt:g} s, and the update's controller decides for"
            f" {controller.dt:g} s; make it with dt={dt:g}"
        )


def closed_loop(
    controller: Controller, q: ArrayLike, ticks: int, update: Update | None = None
) -> Iterator[LoopTick]:
    """Yield the ticks of a robot that moves exactly as commanded, from rest at ``q`` (nq,).

    Each tick's velocity is integrated over one time step. The loop ends after ``ticks`` ticks,
    when the controller raises, or when ``update`` returns None.

    Parameters
    ----------
    controller:
        Gives the robot and the time step, and the commands if there is no ``update``.
    update:
        Called before each tick, for instance to move targets; see :data:`Update`.

    Raises
    ------
    InvalidInputError
        An unusable configuration, or an update whose controller has another time step.
    """
    robot, dt = controller.robot, controller.dt
    q = robot.check_configuration(q)
    v: Array = np.zeros(robot.nv)
    for k in range(ticks):
        began, cpu_began = perf_counter(), thread_time()
        snapshot = robot.snapshot(q, v)
        present = controller if update is None else update(k, snapshot)
        if present is None:
            return
        check_period(present, dt)
        gave_up = False
        try:
            tick = present.step(snapshot)
        except ControllerFailure as failure:
            if not isinstance(failure.tick, Tick):
                raise
            tick, gave_up = failure.tick, True
        seconds, cpu_seconds = perf_counter() - began, thread_time() - cpu_began
        v = tick.velocity
        q = robot.integrate(q, v, dt)
        yield LoopTick(k * dt, snapshot, tick, q, seconds, cpu_seconds, gave_up)
        if gave_up:
            return
