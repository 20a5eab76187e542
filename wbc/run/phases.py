"""Runs in phases: what is held, and which tasks act with which weights, from phase to phase.

A command does not jump where a phase begins: targets and weights move by minimum-jerk ramps, whose
rate is zero at both ends; a foot is let go of by a task of full weight that holds it where it is,
and is held where it has come to rest.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wbc.constraints import Contact
from wbc.controllers import Controller
from wbc.controllers.closed_loop import ticks_of
from wbc.robot import Snapshot
from wbc.run.phase_support import (
    FLAT,
    Ground,
    PhaseSupport,
    keep_anchors,
    off_the_ground,
    touchdowns,
)
from wbc.run.ramps import Goal, MinimumJerk, MovingTarget, TargetedTask
from wbc.tasks import Task
from wbc.validate import Array

# Part of its full weight that a task in use has at least. Never zero: a row without weight is left
# out of strict levels, and a level must not gain or lose rows within a phase.
LEAST_WEIGHT = 1e-6

# A foot has come to the ground when it bears this part of the robot's weight.
TOUCHDOWN_LOAD = 0.02
# Returns the normal force on each foot [N], by its name.
Loads = Callable[[], Mapping[str, float]]

# Makes a controller of the tasks in use and of what is held, at a state.
MakeController = Callable[[Sequence[Task], Sequence[Contact], Snapshot], Controller]
# Gives a controller other tasks and other things to hold, at a state.
ChangeController = Callable[[Controller, Sequence[Task], Sequence[Contact], Snapshot], None]


@dataclass(frozen=True, eq=False)
class Change:
    """What a phase does with a task."""

    goal: Goal | None  # where its target goes; None: it stays where it is
    weight: Array | None  # (k,) at the end of the phase; None: the task is off
    at_once: bool = False  # the task comes in or goes out at once, and not within the phase


@dataclass(frozen=True, eq=False)
class Phase:
    """A part of a run; a run without phases is one, without a name.

    Attributes
    ----------
    begins, duration:
        [s], from the start of the run.
    hold:
        Returns what is held from a state on.
    changes:
        What happens to each task, by name.
    until_touchdown:
        It ends as soon as every foot that the next phase puts down bears load and lies flat, after
        ``duration`` at the latest.
    ramp:
        In which targets and weights move, from its beginning [s].
    """

    name: str
    begins: float
    duration: float
    hold: Callable[[Snapshot], Sequence[Contact]]
    changes: Mapping[str, Change]
    ramp: float
    until_touchdown: bool = False

    @property
    def ends(self) -> float:
        """When it ends [s]."""
        return self.begins + self.duration

    def first_tick(self, dt: float) -> int:
        """Return the first tick that belongs to it; a tick that hits its beginning does."""
        return ticks_of(self.begins, dt)


class PhaseExecutor:
    """Leads a run through its phases; :meth:`update` is for :func:`wbc.run.closed_loop`.

    Parameters
    ----------
    phases:
        In order; the first begins at 0.
    tasks:
        All tasks; names must differ.
    active:
        Names of those that are in use when the run starts.
    make_controller:
        Called when the first phase begins.
    change_controller:
        Called when another one does: warm starts and forces go on from phase to phase.
    start:
        The state in which the run starts.
    move_world:
        Called before each tick with the time [s], for instance to move obstacles.
    ground, flat:
        What a foot is put down on, and how flat: see :func:`wbc.run.phase_support.off_the_ground`.
    loads:
        What feet feel, for phases that end at touchdown; without it they last their duration. What
        they end early, the last phase lasts longer.

    Attributes
    ----------
    controller:
        The same in all phases.
    standing:
        What is held and kept in it.
    complaint:
        Why a phase could not begin, which ended the run; else None.
    notes:
        None.
    """

    def __init__(
        self,
        phases: Sequence[Phase],
        tasks: Sequence[TargetedTask],
        active: Container[str],
        make_controller: MakeController,
        change_controller: ChangeController,
        start: Snapshot,
        move_world: Callable[[float], None] | None = None,
        ground: Ground | None = None,
        flat: float = FLAT,
        loads: Loads | None = None,
    ) -> None:
        self._ground, self._flat, self._loads = ground, flat, loads
        self._early = 0.0  # s, by which phases have ended before their time
        self.tasks = tuple(one.task for one in tasks)
        self.complaint: str | None = None
        self.notes: Sequence[str] = ()
        self._change_controller, self._move_world = change_controller, move_world
        self._targeted = {one.task.name: one for one in tasks}
        # (k,) with which each task acts; None: it is off.
        self._weights: dict[str, Array | None] = {
            name: one.weight if name in active else None for name, one in self._targeted.items()
        }
        # What a task weighs if it is in use: as in the last phase in which it was.
        self._full = {name: one.weight for name, one in self._targeted.items()}
        self._targets = {
            name: one.goal(start, one.current(start)) for name, one in self._targeted.items()
        }
        for name, target in self._targets.items():  # set, at rest
            one = self._targeted[name]
            one.set_target(*MinimumJerk(target, target, 1.0, one.space).at(0.0))
        moving = (one.moving(start) for one in tasks)
        self._lasting = [one for one in moving if one is not None]  # from the start to their end
        self._moving: list[MovingTarget] = []  # within a phase
        self.ramps_over = max((one.course.duration for one in self._lasting), default=0.0)
        if move_world is not None:
            move_world(0.0)
        first, *self._coming = phases
        held = tuple(first.hold(start))
        self.controller = make_controller(self._changed(first, start), held, start)
        self._enter(first, held)
        self._attended = [one.attendant(self.controller) for one in tasks if one.attendant]

    @classmethod
    def single(cls, controller: Controller, start: Snapshot) -> PhaseExecutor:
        """Return a run of one phase with one controller, whose targets stay where they are."""
        held = tuple(one for one in controller.contacts if isinstance(one, Contact))
        phase = Phase("", 0.0, np.inf, lambda _: held, {}, np.inf)
        # No second phase begins, which would change the controller.
        executor = cls([phase], [], (), lambda *_: controller, lambda *_: None, start)
        executor.tasks = controller.tasks
        return executor

    def update(self, tick: int, snapshot: Snapshot) -> Controller | None:
        """Make everything ready for a tick and return its controller.

        None if the phase that begins cannot: a foot that should stand is in the air. Then
        :attr:`complaint` says so.
        """
        dt = self.controller.dt
        if self._move_world is not None:
            self._move_world(tick * dt)
        while self._coming:
            phase = self._coming[0]
            phase = replace(phase, begins=phase.begins - self._early)
            if tick < phase.first_tick(dt):
                if not self._landed(phase, snapshot):
                    break
                self._early += phase.begins - tick * dt
                phase = replace(phase, begins=tick * dt)
            self._coming.pop(0)
            held = self.standing.contacts
            contacts = keep_anchors(held, phase.hold(snapshot))
            for foot in touchdowns(held, contacts):
                reason = off_the_ground(snapshot, foot, self._ground, self._flat)
                if reason is not None:
                    self.complaint = f"phase {phase.name!r} cannot begin: {reason}"
                    return None
            for moving in self._moving:  # what the last phase moved is at its end, and rests
                moving.move_to(np.inf)
            self._moving = []
            tasks = self._changed(phase, snapshot)
            self._change_controller(self.controller, tasks, contacts, snapshot)
            self._enter(phase, contacts)
        self._move_targets(tick * dt)
        for attend in self._attended:
            attend(snapshot)
        return self.controller

    def move_to(self, time: float) -> None:
        """Set every moving target, weight and obstacle to its value at ``time`` [s]."""
        if self._move_world is not None:
            self._move_world(time)
        self._move_targets(time)

    def _landed(self, following: Phase, snapshot: Snapshot) -> bool:
        """Return whether the present phase ends now since the feet of the next have come down."""
        if self._loads is None or not self._present.until_touchdown:
            return False
        feet = touchdowns(self.standing.contacts, following.hold(snapshot))
        loads, least = self._loads(), TOUCHDOWN_LOAD * snapshot.robot.weight
        return all(
            loads[foot] > least and off_the_ground(snapshot, foot, self._ground, self._flat) is None
            for foot in feet
        )

    def _move_targets(self, time: float) -> None:
        for moving in (*self._lasting, *self._moving):
            moving.move_to(time)

    def _changed(self, phase: Phase, snapshot: Snapshot) -> list[Task]:
        """Begin what a phase does with the tasks; return those in use in it."""
        return [
            self._targeted[name].task
            for name, change in phase.changes.items()
            if self._change(name, change, phase, snapshot)
        ]

    def _enter(self, phase: Phase, contacts: tuple[Contact, ...]) -> None:
        """Take note of the phase that the controller is in from now on."""
        self._present, now = phase, self.controller
        self.standing = PhaseSupport.on(
            phase.name, contacts, now.constraints, now.limits, now.slacks.is_hard
        )

    def _change(self, name: str, change: Change, phase: Phase, snapshot: Snapshot) -> bool:
        """Begin what a phase does with a task; True if it is in use in that phase."""
        task, before = self._targeted[name], self._weights[name]
        if change.goal is not None and change.weight is not None:
            here = self._targets[name] if before is not None else task.current(snapshot)
            goal = change.goal(snapshot, here)
            ramp = MinimumJerk(here, goal, phase.ramp, task.space)
            self._moving.append(MovingTarget(ramp, task.set_target, phase.begins))
            self._targets[name] = goal
        self._weights[name] = change.weight
        in_use = self._change_weight(name, before, change, phase)
        if change.weight is not None:
            self._full[name] = change.weight
        return in_use

    def _change_weight(self, name: str, before: Array | None, change: Change, phase: Phase) -> bool:
        """Begin the ramp of a task's weight, or set it; True if it has any."""
        task, end = self._targeted[name].task, change.weight
        if (before is None and end is None) or (end is None and change.at_once):
            return False
        # A foot let go of comes in with all its weight, for the contact's was without bound.
        off = self._full[name] if change.at_once else np.zeros(len(task.rows))
        begin, end = off if before is None else before, off if end is None else end
        if not (begin != end).any():
            task.weight = begin
        else:
            least = LEAST_WEIGHT * np.maximum(begin, end)

            def set_weight(value: Array, *_: Array) -> None:
                task.weight = np.maximum(value, least)

            ramp = MinimumJerk(begin, end, phase.ramp)
            self._moving.append(MovingTarget(ramp, set_weight, phase.begins))
            set_weight(begin, begin, begin)
        return True
