"""What is kept of a simulation while it goes on: the truth, the ticks, and what gave way."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from wbc.controllers.closed_loop import LoopTick
from wbc.robot import Snapshot
from wbc.run.history import HistoryRecorder as RunRecorder
from wbc.run.supervisor import Supervisor
from wbc.simulation.falling import Verdict
from wbc.simulation.loop import SimulationTick
from wbc.simulation.plant import Plant
from wbc.simulation.recorder import Recorder


class TrialRecord:
    """Keeps the control periods of a trial, from the state that its plant is in.

    Attributes
    ----------
    truth:
        States and forces of the plant.
    run:
        What the controller saw and answered; what is to be kept is judged by the truth.
    pushes, wrenches:
        What will push the robot, and act on it for longer.
    verdict:
        Whether it stands.
    gave_way:
        In how many ticks each thing gave way, by name.
    relaxed, lost:
        Ticks in which anything did, and control periods for which nothing was measured.
    tilt:
        Angles of the trunk from its first vertical [rad], of the first state and every period's.
    """

    def __init__(self, plant: Plant, phases: Supervisor) -> None:
        self.truth, self.run = Recorder(plant), RunRecorder(plant.robot, phases.tasks)
        self.pushes, self.wrenches = tuple(plant.pushes), tuple(plant.wrenches)
        self.verdict = Verdict(True, plant.time, "stood for 0 s")
        self.gave_way = Counter[str]()
        self.relaxed = self.lost = 0
        self.tilt = [0.0]
        self._plant, self._phases = plant, phases

    @property
    def notes(self) -> tuple[str, ...]:
        """What physics and supervisor have to say, and which pushes the end cut short."""
        end, dt = self._plant.time, self._plant.dt
        cut = [
            f"the push on {one.body} from {one.start:g} s on lasts until {late:g} s, and was over"
            f" with the simulation, at {end:g} s"
            for one in self.pushes
            if self.verdict.stood and one.start < end < (late := one.start + one.duration) - dt / 2
        ]
        return (*self._plant.notes, *self._phases.notes, *cut)

    @property
    def ticks(self) -> int:
        """Control periods kept."""
        return len(self.run.states)

    def add(self, now: SimulationTick) -> LoopTick:
        """Keep a control period; return it as a tick of a run, by when it began."""
        kept = as_loop_tick(now, self._plant.dt)
        self.truth.add(now.tick)
        self.run.add(kept, self._phases.standing, truth=self._truth(now))
        self.gave_way.update(now.tick.relaxed)
        self.relaxed += bool(now.tick.policy)
        self.lost += not now.fresh
        self.verdict = now.verdict
        self.tilt.append(now.verdict.tilt)
        return kept

    def info(self) -> dict[str, Any]:
        """Return the progress of the trial."""
        return {"time": self._plant.time, "errors": {}, "failed": self.relaxed}

    def _truth(self, now: SimulationTick) -> Snapshot:
        """Return where the robot really was when a control period began."""
        q, v = now.state
        if np.array_equal(q, now.snapshot.q) and np.array_equal(v, now.snapshot.v):
            return now.snapshot
        return self._plant.robot.snapshot(q, v)


def as_loop_tick(now: SimulationTick, dt: float) -> LoopTick:
    """Return a control period of ``dt`` [s] as a tick of a loop, by when it began."""
    return LoopTick(
        now.time - dt, now.snapshot, now.tick, now.snapshot.q, now.seconds, now.cpu_seconds, False
    )
