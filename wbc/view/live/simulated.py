"""An interactive simulation in the browser, with pushes and pulls."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from wbc.controllers.closed_loop import LoopTick, Update
from wbc.errors import InvalidInputError
from wbc.robot import Snapshot
from wbc.run.phase_support import held_feet
from wbc.run.supervisor import Supervisor
from wbc.simulation import FallLimits, Plant, capture_impulse, simulate
from wbc.simulation.push import Push
from wbc.simulation.trial_record import as_loop_tick
from wbc.validate import Array
from wbc.view.live.clock import Clock
from wbc.view.live.messages import (
    PUSH_DURATION,
    PullForce,
    PullRobot,
    PushRobot,
    ReleasePull,
    Request,
)
from wbc.view.live.session import ENDLESS, Session
from wbc.view.live.viewer import Viewer

if TYPE_CHECKING:
    from wbc.problem.problem import Problem

PUSH_RATIO = 2.5  # times M omega d in the direction in which that is largest
PUSH_SPEED = 0.5  # m/s: speed from the strongest push of a robot that cannot be caught by its feet


class SimulatedSession(Session):
    """Simulates a problem of the torque level and shows it; see :class:`Session`.

    The simulation goes on when the problem's time is over, until the robot falls.
    """

    def __init__(self, problem: Problem, viewer: Viewer, clock: Clock | None = None) -> None:
        super().__init__(problem, viewer, clock)
        self._plant: Plant  # of the present run: made as it begins
        self._falls = FallLimits(**problem.spec.simulation.falls)
        self._verdict = ""
        self._wanted_pull: PullRobot | None = None
        self._pull: Push | None = None  # that of the last period

    def _supervisor(self) -> Supervisor:
        self._plant, self._pull = self._problem.plant(), None
        return self._problem.supervisor(self._plant)

    def _loop(self, phases: Supervisor, update: Update) -> Iterator[LoopTick]:
        plant, dt = self._plant, self._plant.dt
        loop = simulate(phases.controller, plant, ENDLESS * dt, update=update, falls=self._falls)
        for now in loop:
            self._verdict = now.verdict.reason
            yield as_loop_tick(now, dt)
            self._pull_for(dt)

    def _why_ended(self, now: LoopTick | None) -> str:
        return self._verdict

    def _pull_for(self, dt: float) -> None:
        """Pull the plant for the next period ``dt`` [s], if the user wants it."""
        self._pull, now = None, self._pull_now()
        if now is not None and self._wanted_pull is not None:
            point = self._wanted_pull.point
            self._pull = self._plant.push(now.frame, now.force, point, duration=dt)

    def _pull_now(self) -> PullForce | None:
        if self._wanted_pull is None:
            return None
        return pull_force(self._wanted_pull, self._plant.snapshot())

    def _push_now(self) -> Array:
        every = self._plant.push_force
        if self._pull is None:
            return every
        others = every - self._pull.force
        rounding = 1e-9 * float(np.linalg.norm(self._pull.force))
        return others if np.linalg.norm(others) > rounding else np.zeros(3)

    def _receive(self, request: Request) -> None:
        match request:
            case PushRobot(impulse):
                force = impulse / PUSH_DURATION
                self._plant.push("base", force, "com", duration=PUSH_DURATION)
            case PullRobot():
                self._wanted_pull = request
            case ReleasePull():
                self._wanted_pull = None
            case _:
                super()._receive(request)


def pull_force(wanted: PullRobot, now: Snapshot) -> PullForce:
    """Return the force of a pull's spring, at most the robot's weight."""
    rotation, origin = now.rotation(wanted.frame), now.position(wanted.frame)
    point = origin + rotation @ wanted.point
    force = wanted.stiffness * (wanted.target - point)
    largest, strength = now.robot.weight, float(np.linalg.norm(force))
    return PullForce(
        wanted.frame, point, force * (largest / strength if strength > largest else 1.0)
    )


def strongest_push(problem: Problem) -> float:
    """Return the largest push that the page offers [N s]."""
    parts = problem.parts
    start = parts.at_start
    feet = held_feet(parts.contacts)
    ways = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
    try:
        return PUSH_RATIO * max(capture_impulse(start, feet, way) for way in ways)
    except InvalidInputError:  # on no feet, or leaning beyond them, as at the start on a slope
        return PUSH_SPEED * parts.robot.mass
