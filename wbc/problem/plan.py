"""The phases of a problem file as a plan: each phase's initial contacts and its changes.

Names, numbers and contradictions are checked before the run. Whether a foot has really reached the
ground is checked in the run.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import partial
from itertools import zip_longest

import numpy as np
from pydantic import ValidationError

from wbc.constraints import Contact
from wbc.errors import InvalidInputError, UnknownNameError, WbcError
from wbc.problem.levels import REMEDY, TORQUE
from wbc.problem.mistakes import Misplaced, Mistakes, complaints
from wbc.problem.plan_targets import refuse_course
from wbc.problem.section import KnownKeys
from wbc.problem.spec import PhaseSpec, PhaseTaskSpec, ProblemSpec
from wbc.problem.support import contacts_of, slack_by_frame
from wbc.problem.targets import FromPlan
from wbc.problem.task_spec import TaskSpec
from wbc.robot import Snapshot
from wbc.run.phase_support import PhaseSupport, carrier, held_joints, off_the_ground, touchdowns
from wbc.run.phases import Change, Phase
from wbc.run.ramps import TargetedTask


def single_phase(spec: ProblemSpec, built: Mapping[str, TargetedTask]) -> Phase:
    """Return the only phase of a problem that describes none."""
    changes = {
        name: Change(None, one.weight if spec.tasks[name].active else None)
        for name, one in built.items()
    }
    hold = partial(contacts_of, spec.support, friction=spec.controller.friction_cone)
    duration = spec.whole_stop.duration
    return Phase("", 0.0, duration, hold, changes, duration)


def plan(
    spec: ProblemSpec, built: Mapping[str, TargetedTask], start: Snapshot, mistakes: Mistakes
) -> tuple[Phase, ...]:
    """Return the phases of a problem in order; mistakes are noted in ``mistakes``."""
    if spec.phases is None:
        _check_start_tasks(spec, start, mistakes)
        return (single_phase(spec, built),)
    planner = _Planner(spec, built, start, mistakes)
    phases = tuple(planner.phase(name, phase) for name, phase in spec.phases.items())
    _check_touchdowns(spec, phases, start, mistakes)
    return phases


class _Planner:
    """Goes through the phases, keeping the state that each inherits."""

    def __init__(
        self,
        spec: ProblemSpec,
        built: Mapping[str, TargetedTask],
        start: Snapshot,
        mistakes: Mistakes,
    ) -> None:
        self._start, self._mistakes = start, mistakes
        self._ground = spec.ground_height
        self._dt, self._friction = spec.controller.dt, spec.controller.friction_cone
        self._specs: dict[str, TaskSpec] = {name: spec.tasks[name] for name in built}
        self._names = tuple(spec.tasks)
        self._built = dict(built)
        self._active = {name: task.active for name, task in self._specs.items()}
        self._support = spec.support
        self._contacts: tuple[Contact, ...] | None = None  # of the phase before
        self._time = 0.0

    def phase(self, name: str, spec: PhaseSpec) -> Phase:
        """Return the next phase."""
        if spec.duration < self._dt:
            text = f"{spec.duration:g} s is shorter than the time step ({self._dt:g} s)"
            self._mistakes.note(("phases", name, "duration"), text)
        if spec.ramp is not None and spec.ramp > spec.duration:
            text = f"{spec.ramp:g} s is longer than the phase"
            self._mistakes.note(("phases", name, "ramp"), text)
        before, contacts = self._contacts, self._phase_contacts(name, spec)
        was_active = dict(self._active)
        given: dict[str, TargetedTask] = {}
        for task, change in spec.tasks.items():
            with self._mistakes.at("phases", name, "tasks", task):
                given |= self._change(name, task, change, contacts)
        self._check_held(name, spec, contacts)
        changes = {
            task: self._outcome(task, was_active[task], task in given, before, contacts)
            for task in self._built
        }
        hold = partial(contacts_of, self._support, friction=self._friction)
        touchdown = spec.until == "touchdown"
        ramp = spec.duration if spec.ramp is None else spec.ramp
        phase = Phase(name, self._time, spec.duration, hold, changes, ramp, touchdown)
        self._contacts, self._time = contacts, phase.ends
        return phase

    def _phase_contacts(self, name: str, spec: PhaseSpec) -> tuple[Contact, ...]:
        """Return the contacts of a phase; their anchors are set in the run."""
        first = self._contacts is None
        if spec.support is not None:
            self._support = spec.support
        elif not first:
            return self._contacts or ()
        # Without its own support the first phase has the problem's, which has been checked.
        where = ("support",) if spec.support is None else ("phases", name, "support")
        contacts: tuple[Contact, ...] = ()
        with self._mistakes.at(*where):
            contacts = contacts_of(self._support, self._start, self._friction)
            standing = PhaseSupport.on("", contacts).feet
            lifted = (off_the_ground(self._start, foot, self._ground) for foot in standing)
            for complaint in filter(None, lifted if first else ()):
                raise InvalidInputError(complaint)
        return contacts

    def _change(
        self, phase: str, name: str, change: PhaseTaskSpec, contacts: Iterable[Contact]
    ) -> dict[str, TargetedTask]:
        """Apply a phase's changes to a task; return it if it has a new target."""
        if name not in self._names:
            raise UnknownNameError("task", name, self._names)
        if name not in self._built:  # its own description is wrong, which has been noted
            return {}
        if change.active is not None:
            self._active[name] = change.active
        wanted = {"target": change.target, "weight": change.weight}
        given = {key: value for key, value in wanted.items() if value is not None}
        if not self._active[name]:
            for key in sorted(given):
                raise Misplaced(f"task {name!r} is off in this phase; give active: true", key)
        if not given:
            return {}
        spec = self._merged(("phases", phase, "tasks", name), self._specs[name], given)
        if spec is None:
            return {}
        if "target" in given:
            refuse_course(spec.target, self._specs[name].target)
            _check_feet_below(spec, self._start, contacts)
        spec.check_change(self._specs[name])
        self._built[name] = spec.build(name, self._start)
        self._specs[name] = spec
        return {name: self._built[name]} if "target" in given else {}

    def _merged(
        self, path: tuple[str, ...], spec: TaskSpec, given: Mapping[str, object]
    ) -> TaskSpec | None:
        """Return the task's description with the phase's changes, or None if these are wrong."""
        data = {**spec.model_dump(exclude_unset=True), **given}
        keys: dict[int, KnownKeys] = {}
        try:
            return type(spec).model_validate(data, context=keys)
        except ValidationError as error:
            for place, text in complaints(error, self._mistakes.source, keys, path):
                self._mistakes.note(place, text)
        return None

    def _check_held(self, name: str, spec: PhaseSpec, contacts: tuple[Contact, ...]) -> None:
        """Refuse a task that moves a held frame, and a phase without active tasks."""
        held = held_joints(self._start.robot, contacts)
        frames = {carrier(self._start.robot, contact.frame): contact.frame for contact in contacts}
        for task, active in self._active.items():
            joint = self._moving_joint(task)
            if active and joint in held:
                below = ("tasks", task) if task in spec.tasks else ()
                self._mistakes.note(("phases", name, *below), _held_frame(task, frames[joint]))
        if self._active and not any(self._active.values()):
            text = "no task is active; there is nothing to do"
            self._mistakes.note(("phases", name), text)

    def _outcome(
        self,
        name: str,
        was_active: bool,
        given: bool,
        before: tuple[Contact, ...] | None,
        contacts: tuple[Contact, ...],
    ) -> Change:
        built, active = self._built[name], self._active[name]
        robot, joint = self._start.robot, self._moving_joint(name)
        at_once = before is not None and (
            (joint in held_joints(robot, before)) != (joint in held_joints(robot, contacts))
        )
        follows = isinstance(self._specs[name].target, FromPlan)
        goal = built.goal if active and (given or not was_active) and not follows else None
        return Change(goal, built.weight if active else None, at_once)

    def _moving_joint(self, name: str) -> int | None:
        """Return the joint that moves the frame of a task; None if the task has no frame."""
        frame = self._specs[name].moved_frame
        return None if frame is None else carrier(self._start.robot, frame)


def _check_start_tasks(spec: ProblemSpec, start: Snapshot, mistakes: Mistakes) -> None:
    """Refuse tasks without weight, and those that move a frame held by a hard contact."""
    try:
        contacts = contacts_of(spec.support, start)
    except WbcError:  # noted where the support is made
        return
    soft = slack_by_frame(start.robot, [spec.support])
    held = held_joints(start.robot, [one for one in contacts if one.frame not in soft])
    for name, task in spec.tasks.items():
        with mistakes.at("tasks", name), suppress(UnknownNameError):  # of the frame: noted before
            if task.active and not np.any(task.weight):
                raise Misplaced(
                    "without weight the task does nothing; give active: false", "weight"
                )
            if not task.active or task.moved_frame is None:
                continue
            if carrier(start.robot, task.moved_frame) in held:
                raise InvalidInputError(_held_frame(name, task.moved_frame))


def _held_frame(task: str, frame: str) -> str:
    return (
        f"task {task!r} moves what the support holds ({frame}); give active: false, or let go of it"
    )


def _check_touchdowns(
    spec: ProblemSpec, phases: tuple[Phase, ...], start: Snapshot, mistakes: Mistakes
) -> None:
    """Refuse phases that wait for a touchdown without sensors, or without a foot to touch down."""
    for phase, following in zip_longest(phases, phases[1:]):
        if not phase.until_touchdown:
            continue
        with mistakes.at("phases", phase.name, "until"):
            if spec.controller.level != TORQUE:
                raise InvalidInputError(f"belongs to the torque level; {REMEDY[TORQUE]}")
            with suppress(UnknownNameError):  # of a support: noted before
                if following is None or not touchdowns(phase.hold(start), following.hold(start)):
                    raise InvalidInputError("the next phase puts no foot down: give its support")


def _check_feet_below(spec: TaskSpec, start: Snapshot, contacts: Iterable[Contact]) -> None:
    standing = PhaseSupport.on("", tuple(contacts)).feet
    for foot in spec.feet_below(start.robot):
        if foot not in standing:
            raise Misplaced(
                f"the {foot} foot does not stand in this phase (standing: "
                f"{', '.join(standing) or 'none'})",
                "target",
                "over",
            )
