"""Runs in phases, each with its contacts, tasks and weights.

Commands are continuous between phases: targets and weights move on minimum-jerk ramps, whose rate
is zero at both ends; at lift-off a task of full weight takes over from a foot's contact, and a new
contact is made where the foot has come to rest.
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
    SOLE_FLATNESS,
    Ground,
    PhaseSupport,
    keep_anchors,
    off_the_ground,
    touchdowns,
)
from wbc.run.ramps import Goal, MinimumJerk, MovingTarget, TargetedTask
from wbc.tasks import Task
from wbc.validate import Array

# Smallest weight of a task in use, as a ratio of its full one. Not zero: strict levels drop rows
# without weight, and a level must not gain or lose rows within a phase.
MIN_WEIGHT_RATIO = 1e-6

# A foot has touched down when it bears this part of the robot's weight.
TOUCHDOWN_LOAD = 0.02
# Returns the normal force on each foot [N], by its name.
Loads = Callable[[], Mapping[str, float]]

# Makes a controller from the tasks in use and the contacts, at a state.
MakeController = Callable[[Sequence[Task], Sequence[Contact], Snapshot], Controller]
# Gives a controller other tasks and contacts, at a state.
ChangeController = Callable[[Controller, Sequence[Task], Sequence[Contact], Snapshot], None]


@dataclass(frozen=True, eq=False)
class Change:
    """Change of a task in a phase."""

    goal: Goal | None  # of its target; None: unchanged
    weight: Array | None  # (k,) at the end of the phase; None: the task is off
    at_once: bool = False  # whether the task is switched on or off without a ramp


@dataclass(frozen=True, eq=False)
class Phase:
    """A part of a run; a run without phases is one, without a name.

    Attributes
    ----------
    begins, duration:
        [s], from the start of the run.
    hold:
        Returns the contacts at a state.
    changes:
        Of the tasks, by name.
    until_touchdown:
        Whether it ends as soon as every foot that the next phase stands on bears load and is flat,
        after ``duration`` at the latest.
    ramp:
        Duration of the ramps of targets and weights, from its beginning [s].
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
        """End of the phase [s]."""
        return self.begins + self.duration

    def first_tick(self, dt: float) -> int:
        """Return the first tick of the phase, at its beginning or later."""
        return ticks_of(self.begins, dt)


class PhaseExecutor:
    """Executes the phases of a run; :meth:`update` is for :func:`wbc.run.closed_loop`.

    Parameters
    ----------
    phases:
        In order; the first begins at 0.
    tasks:
        All tasks; names must differ.
    active:
        Names of those in use at the start.
    make_controller:
        Called when the first phase begins.
    change_controller:
        Called when another one begins: warm starts and forces are kept from phase to phase.
    start:
        The state at the start.
    move_world:
        Called before each tick with the time [s], for instance to move obstacles.
    ground, flat:
        Of touch-downs: see :func:`wbc.run.phase_support.off_the_ground`.
    loads:
        On the feet, for phases that end at touch-down; without it they last their duration. The
        last phase is longer by the time that they end early.

    Attributes
    ----------
    controller:
        The same in all phases.
    standing:
        Contacts and margins now.
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
        flat: float = SOLE_FLATNESS,
        loads: Loads | None = None,
    ) -> None:
        self._ground, self._flat, self._loads = ground, flat, loads
        self._time_saved = 0.0  # by phases that ended early [s]
        self.tasks = tuple(one.task for one in tasks)
        self.complaint: str | None = None
        self.notes: Sequence[str] = ()
        self._change_controller, self._move_world = change_controller, move_world
        self._targeted = {one.task.name: one for one in tasks}
        # (k,) of each task; None: it is off.
        self._weights: dict[str, Array | None] = {
            name: one.weight if name in active else None for name, one in self._targeted.items()
        }
        # Of each task in the last phase in which it was in use.
        self._full_weights = {name: one.weight for name, one in self._targeted.items()}
        self._targets = {
            name: one.goal(start, one.current(start)) for name, one in self._targeted.items()
        }
        for name, target in self._targets.items():  # set, at rest
            one = self._targeted[name]
            one.set_target(*MinimumJerk(target, target, 1.0, one.space).at(0.0))
        moving = (one.moving(start) for one in tasks)
        self._run_targets = [one for one in moving if one is not None]  # whole run
        self._phase_targets: list[MovingTarget] = []  # within a phase
        self.ramps_end = max((one.course.duration for one in self._run_targets), default=0.0)
        if move_world is not None:
            move_world(0.0)
        first, *self._pending = phases
        held = tuple(first.hold(start))
        self.controller = make_controller(self._begin_phase(first, start), held, start)
        self._set_phase(first, held)
        self._law_updates = [one.attendant(self.controller) for one in tasks if one.attendant]

    @classmethod
    def single(cls, controller: Controller, start: Snapshot) -> PhaseExecutor:
        """Return a run of one phase with one controller, whose targets are constant."""
        held = tuple(one for one in controller.contacts if isinstance(one, Contact))
        phase = Phase("", 0.0, np.inf, lambda _: held, {}, np.inf)
        # There is no second phase that would change the controller.
        executor = cls([phase], [], (), lambda *_: controller, lambda *_: None, start)
        executor.tasks = controller.tasks
        return executor

    def update(self, tick: int, snapshot: Snapshot) -> Controller | None:
        """Prepare a tick and return its controller.

        None if the next phase cannot begin, as a foot that it stands on is in the air:
        :attr:`complaint` says so.
        """
        dt, tick = self.controller.dt, max(tick, 0)
        if self._move_world is not None:
            self._move_world(tick * dt)
        while self._pending:
            phase = self._pending[0]
            phase = replace(phase, begins=phase.begins - self._time_saved)
            if tick < phase.first_tick(dt):
                if not self._has_touched_down(phase, snapshot):
                    break
                self._time_saved += phase.begins - tick * dt
                phase = replace(phase, begins=tick * dt)
            self._pending.pop(0)
            held = self.standing.contacts
            contacts = keep_anchors(held, phase.hold(snapshot))
            for foot in touchdowns(held, contacts):
                reason = off_the_ground(snapshot, foot, self._ground, self._flat)
                if reason is not None:
                    self.complaint = f"phase {phase.name!r} cannot begin: {reason}"
                    return None
            for moving in self._phase_targets:  # ramps of the last phase end exactly
                moving.move_to(np.inf)
            self._phase_targets = []
            tasks = self._begin_phase(phase, snapshot)
            self._change_controller(self.controller, tasks, contacts, snapshot)
            self._set_phase(phase, contacts)
        self._move_targets(tick * dt)
        for update_law in self._law_updates:
            update_law(snapshot)
        return self.controller

    def move_to(self, time: float) -> None:
        """Set moving targets, weights and obstacles to their values at ``time`` [s]."""
        if self._move_world is not None:
            self._move_world(time)
        self._move_targets(time)

    def _has_touched_down(self, next_phase: Phase, snapshot: Snapshot) -> bool:
        """Return whether the present phase ends now, as the feet of the next have touched down."""
        if self._loads is None or not self._phase.until_touchdown:
            return False
        feet = touchdowns(self.standing.contacts, next_phase.hold(snapshot))
        loads, touch = self._loads(), TOUCHDOWN_LOAD * snapshot.robot.weight
        return all(
            loads[foot] > touch and off_the_ground(snapshot, foot, self._ground, self._flat) is None
            for foot in feet
        )

    def _move_targets(self, time: float) -> None:
        for moving in (*self._run_targets, *self._phase_targets):
            moving.move_to(time)

    def _begin_phase(self, phase: Phase, snapshot: Snapshot) -> list[Task]:
        """Begin a phase's changes; return the tasks that it uses."""
        return [
            self._targeted[name].task
            for name, change in phase.changes.items()
            if self._begin_change(name, change, phase, snapshot)
        ]

    def _set_phase(self, phase: Phase, contacts: tuple[Contact, ...]) -> None:
        """Set the present phase and its support."""
        self._phase, now = phase, self.controller
        self.standing = PhaseSupport.on(
            phase.name, contacts, now.constraints, now.limits, now.slacks.is_hard
        )

    def _begin_change(self, name: str, change: Change, phase: Phase, snapshot: Snapshot) -> bool:
        """Begin a task's change in a phase; return whether the phase uses it."""
        task, before = self._targeted[name], self._weights[name]
        if change.goal is not None and change.weight is not None:
            current = self._targets[name] if before is not None else task.current(snapshot)
            goal = change.goal(snapshot, current)
            ramp = MinimumJerk(current, goal, phase.ramp, task.space)
            self._phase_targets.append(MovingTarget(ramp, task.set_target, phase.begins))
            self._targets[name] = goal
        self._weights[name] = change.weight
        in_use = self._ramp_weight(name, before, change, phase)
        if change.weight is not None:
            self._full_weights[name] = change.weight
        return in_use

    def _ramp_weight(self, name: str, before: Array | None, change: Change, phase: Phase) -> bool:
        """Begin the ramp of a task's weight, or set it; return whether it has any."""
        task, end = self._targeted[name].task, change.weight
        if (before is None and end is None) or (end is None and change.at_once):
            return False
        # At lift-off a foot's task begins at full weight, as it takes over from a hard contact.
        hidden = self._full_weights[name] if change.at_once else np.zeros(len(task.rows))
        begin, end = hidden if before is None else before, hidden if end is None else end
        if not (begin != end).any():
            task.weight = begin
        else:
            smallest = MIN_WEIGHT_RATIO * np.maximum(begin, end)

            def set_weight(value: Array, *_: Array) -> None:
                task.weight = np.maximum(value, smallest)

            ramp = MinimumJerk(begin, end, phase.ramp)
            self._phase_targets.append(MovingTarget(ramp, set_weight, phase.begins))
            set_weight(begin, begin, begin)
        return True
