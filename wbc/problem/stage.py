"""The part of a run that changes from phase to phase: what is held, and which tasks pull how much.

A command does not jump where a phase begins: targets and weights move by minimum-jerk ramps, whose
rate is zero at both ends; a foot is let go of by a task of full weight that holds it where it is,
and is held where it has come to rest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from wbc.constraints import Contact
from wbc.problem.build_tasks import BuiltTask
from wbc.problem.plan import Change, Phase
from wbc.problem.ramps import MinimumJerk, MovingTarget
from wbc.problem.standing import Standing, carried_on, contacts_of, off_the_ground, put_down
from wbc.robot import Snapshot
from wbc.tasks import Task
from wbc.validate import Array

if TYPE_CHECKING:
    from wbc.problem.build import Controller
    from wbc.problem.problem import Problem

# Part of its full weight that a task in use has at least. Never zero: a row without weight is left
# out of strict levels, and a level must not gain or lose rows within a phase.
FAINTEST = 1e-6


class Stage:
    """Where a run is in its plan.

    Attributes
    ----------
    controller:
        Of the present phase.
    standing:
        What is held in it.
    """

    controller: Controller
    standing: Standing

    def __init__(self, problem: Problem, start: Snapshot) -> None:
        parts = problem.parts
        self._problem = problem
        self._built = {one.task.name: one for one in parts.built}
        self._coming = list(parts.phases)
        self._held: tuple[Contact, ...] = ()
        self._weights = _first_weights(problem)
        # What a task weighs if it is in use: as in the last phase in which it was.
        self._full = {name: one.weight for name, one in self._items()}
        self._targets = {name: one.goal(start, one.actual(start)) for name, one in self._items()}
        for name, one in self._items():
            _rest(self._targets[name], one)
        self._moving = [
            moving for _, one in self._items() if (moving := one.moving(start)) is not None
        ]

    def ready(self, tick: int, snapshot: Snapshot) -> str | None:
        """Make everything ready for a tick.

        Returns
        -------
        None, or in words why the phase that begins cannot: a foot that should stand is in the air.
        """
        dt = self._problem.spec.controller.dt
        self._problem.parts.surroundings.move_to(tick * dt)
        while self._coming and tick >= self._coming[0].first_tick(dt):
            complaint = self._enter(self._coming.pop(0), snapshot)
            if complaint is not None:
                return complaint
        self.move_to(tick * dt)
        return None

    def move_to(self, time: float) -> None:
        """Set every moving target and weight to its value at ``time`` [s]."""
        for moving in self._moving:
            moving.move_to(time)

    def _enter(self, phase: Phase, snapshot: Snapshot) -> str | None:
        contacts = carried_on(self._held, contacts_of(phase.support, snapshot))
        # The start has been looked at when the problem was loaded.
        landed = put_down(self._held, contacts) if phase.begins > 0.0 else ()
        for complaint in filter(None, (off_the_ground(snapshot, foot) for foot in landed)):
            return f"phase {phase.name!r} cannot begin: {complaint}"
        if phase.begins > 0.0:
            self.move_to(np.inf)  # what the last phase moved is at its end, and rests
            self._moving = []
        used = [
            name
            for name, change in phase.changes.items()
            if self._turn(name, change, phase, snapshot)
        ]
        self._held = contacts
        self.standing = Standing.on(phase.name, contacts)
        tasks = [self._built[name].task for name in used]
        self.controller = self._problem.parts.controller(
            self._problem.spec.controller, tasks, contacts, snapshot
        )
        return None

    def _turn(self, name: str, change: Change, phase: Phase, snapshot: Snapshot) -> bool:
        """Begin what a phase does with a task; True if it is in use in that phase."""
        built, before = self._built[name], self._weights[name]
        if change.goal is not None and change.weight is not None:
            here = self._targets[name] if before is not None else built.actual(snapshot)
            goal = change.goal(snapshot, here)
            ramp = MinimumJerk(here, goal, phase.duration, built.space)
            self._moving.append(MovingTarget(ramp, built.hand_over, phase.begins))
            self._targets[name] = goal
        self._weights[name] = change.weight
        in_use = self._weigh(name, before, change, phase)
        if change.weight is not None:
            self._full[name] = change.weight
        return in_use

    def _weigh(self, name: str, before: Array | None, change: Change, phase: Phase) -> bool:
        """Begin the ramp of a task's weight, or set it; True if it has any."""
        task, end = self._built[name].task, change.weight
        if (before is None and end is None) or (end is None and change.at_once):
            return False
        # A foot let go of comes in with all its weight, for the contact's was without bound.
        off = self._full[name] if change.at_once else np.zeros(len(task.rows))
        begin, end = off if before is None else before, off if end is None else end
        task.weight = begin
        if (begin != end).any():
            hand_over = _weight_of(task, FAINTEST * np.maximum(begin, end))
            ramp = MinimumJerk(begin, end, phase.duration)
            self._moving.append(MovingTarget(ramp, hand_over, phase.begins))
            hand_over(begin, begin, begin)
        return True

    def _items(self) -> list[tuple[str, BuiltTask]]:
        return list(self._built.items())


def _first_weights(problem: Problem) -> dict[str, Array | None]:
    """Return the weights (k,) that the tasks begin with; None for those that are off."""
    return {
        one.task.name: one.weight if problem.spec.tasks[one.task.name].active else None
        for one in problem.parts.built
    }


def _rest(target: Array, built: BuiltTask) -> None:
    """Set a target that does not move."""
    built.hand_over(*MinimumJerk(target, target, 1.0, built.space).at(0.0))


def _weight_of(task: Task, least: Array) -> Callable[[Array, Array, Array], None]:
    def hand_over(value: Array, _: Array, __: Array) -> None:
        task.weight = np.maximum(value, least)

    return hand_over
