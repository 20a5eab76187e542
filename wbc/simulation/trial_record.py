"""The record of a running simulation: true states, ticks, and relaxations."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from wbc.constraints.contact import Contact
from wbc.constraints.mechanics import holds_bolted
from wbc.controllers.closed_loop import LoopTick
from wbc.controllers.torque_tick import TorqueTick
from wbc.robot import Snapshot
from wbc.run.history import HistoryRecorder as RunRecorder
from wbc.run.supervisor import Supervisor
from wbc.simulation.falling import Verdict
from wbc.simulation.loop import SimulationTick
from wbc.simulation.plant import Plant
from wbc.simulation.recorder import Recorder
from wbc.validate import Array

LOADED = 0.01  # of the robot's weight: a contact that should bear less is not missed


class UnmetContacts:
    """Watches a simulation for contacts that nothing there meets.

    A grip in the air, or a hand that leans on a wall that nobody built, exists in the controller
    alone, and its robot falls.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._grips: dict[str, bool] = {}  # of the contacts that should have borne load, by frame
        self._touching = set[int]()  # joints whose links touch anything of the world

    def add(self, tick: TorqueTick) -> None:
        """Count a control period, at its end."""
        robot = self._plant.robot
        for link in set(self._plant.contacts.links):
            self._touching.add(robot.frame(link).parentJoint)
        wanted: dict[str, Array] = {}
        for part in tick.reaction.layout.parts:
            contact = part.contact
            if not isinstance(contact, Contact) or holds_bolted(contact):
                continue
            if contact.frame not in self._grips:
                wanted = wanted or tick.forces
                if abs(wanted[contact.name][:3]).max() > LOADED * robot.weight:
                    self._grips[contact.frame] = contact.friction is None

    @property
    def notes(self) -> tuple[str, ...]:
        """What the controller relied on in vain, in words."""
        robot, touching = self._plant.robot, self._touching
        missing = [one for one in self._grips if robot.frame(one).parentJoint not in touching]
        grips = [one for one, grip in self._grips.items() if grip and one not in missing]
        notes = []
        if missing:
            notes.append(
                f"nothing touched {', '.join(missing)}, where the controller relied on forces: the"
                " simulation has the ground, and steps and walls of its terrain"
            )
        if grips:
            notes.append(
                f"{', '.join(grips)}: grips of the controller alone, where the simulation's ground"
                " pushes, with friction, and never pulls"
            )
        return tuple(notes)


class TrialRecord:
    """Records the control periods of a trial, from the plant's present state.

    ``truth``: states and forces of the plant.
    ``run``: measured states and ticks; conditions are judged by the true states.
    ``pushes``, ``wrenches``: all pushes and longer wrenches.
    ``verdict``: whether the robot stands.
    ``gave_way``: number of ticks in which each row was relaxed, by name.
    ``relaxed``, ``lost``: number of relaxed ticks, and of control periods without a measurement.
    ``tilt``: angles of the trunk from its initial vertical [rad], of the first state and every
    period.
    """

    def __init__(self, plant: Plant, phases: Supervisor) -> None:
        self.truth, self.run = Recorder(plant), RunRecorder(plant.robot, phases.tasks)
        self.pushes, self.wrenches = tuple(plant.pushes), tuple(plant.wrenches)
        self.verdict = Verdict(True, plant.time, "stood for 0 s")
        self.gave_way = Counter[str]()
        self.relaxed = self.lost = 0
        self.tilt = [0.0]
        self._plant, self._phases = plant, phases
        self._unmet = UnmetContacts(plant)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of physics and supervisor, unmet contacts, and pushes that the end cut short."""
        end, dt = self._plant.time, self._plant.dt
        cut_short = [
            f"the push on {one.body} from {one.start:g} s on lasts until {one.end:g} s, and was"
            f" over with the simulation, at {end:g} s"
            for one in self.pushes
            if self.verdict.stood and one.start < end < one.end - dt / 2
        ]
        return (*self._plant.notes, *self._phases.notes, *self._unmet.notes, *cut_short)

    @property
    def ticks(self) -> int:
        """Number of control periods recorded."""
        return len(self.run.states)

    def add(self, now: SimulationTick) -> LoopTick:
        """Record a control period; return it as a tick of a run, timed at its beginning."""
        tick = as_loop_tick(now, self._phases.controller.dt)
        self.truth.add(now.tick)
        self._unmet.add(now.tick)
        self.run.add(tick, self._phases.standing, truth=self._true_state(now))
        self.gave_way.update(now.tick.relaxed)
        self.relaxed += bool(now.tick.policy)
        self.lost += not now.fresh
        self.verdict = now.verdict
        self.tilt.append(now.verdict.tilt)
        return tick

    def info(self) -> dict[str, Any]:
        """Return the progress of the trial."""
        failed, relaxed = len(self.run.failures), self.relaxed
        return {"time": self._plant.time, "errors": {}, "failed": failed, "relaxed": relaxed}

    def _true_state(self, now: SimulationTick) -> Snapshot:
        """Return the true state at the beginning of a control period."""
        q, v = now.state
        if np.array_equal(q, now.snapshot.q) and np.array_equal(v, now.snapshot.v):
            return now.snapshot
        return self._plant.robot.snapshot(q, v)


def as_loop_tick(now: SimulationTick, dt: float) -> LoopTick:
    """Return a control period of ``dt`` [s] as a tick of a loop, timed at its beginning."""
    return LoopTick(
        now.time - dt, now.snapshot, now.tick, now.snapshot.q, now.seconds, now.cpu_seconds, False
    )
