"""Checks and warnings on the parts of a controller, and on the values that they return."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from wbc.constraints.contact import Contact
from wbc.constraints.independent_rows import independent_rows
from wbc.constraints.limits import Limits
from wbc.constraints.mechanics import mechanics_of
from wbc.constraints.rows import Constraint
from wbc.constraints.validation import check_rows
from wbc.controllers.competing_tasks import competing_tasks
from wbc.controllers.contact_forces import displaced
from wbc.controllers.slack import NO_SLACK, Slacks
from wbc.errors import InvalidInputError, listed, shown
from wbc.laws import AccelerationLaw, VelocityLaw
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_robot
from wbc.tasks import validation
from wbc.tasks.contact_force import ContactForceTask, ForceRateTask, LoadShareTask
from wbc.tasks.cop import CopTask
from wbc.tasks.force_task import ForceTask
from wbc.tasks.task import Task
from wbc.validate import Array

# Attributes that are fixed in a controller's plan, and what to do instead of assigning them.
MAKE_ANOTHER = "make another controller"
FIXED = dict.fromkeys(("tasks", "contacts", "constraints"), "call change()") | dict.fromkeys(
    ("robot", "limits", "dt", "damping", "joint_weights", "backend"), MAKE_ANOTHER
)

FAR_OUTSIDE = 0.2  # rad, m: more than any joint's calibration error
# m, rad: farther than a robot comes in a task, and two turns of a joint; numbers of mm and degrees
# are usually more.
FAR_LENGTH, FAR_ANGLE = 25.0, 4.0 * np.pi
# Least singular value of the rows of all contacts, relative to the largest: 0.016 and more on legs
# of six joints, straight ones too. And the least part that a row is named for.
DEPENDENT, LARGE_PART = 1e-3, 0.2
DEFAULT_LAW = VelocityLaw()
# Of the velocity and the torque level: the gains it ignores, its name, the gains it uses.
LEVEL_GAINS = ("kp, kd", "velocity", "gain"), ("gain", "torque", "kp, kd")


def contacts_or_warn(robot: Robot, contacts: Sequence[Task] | None) -> Sequence[Task]:
    """Return the contacts; warn if None are given and a robot with feet would float."""
    if contacts is not None:
        return contacts
    if isinstance(robot, Robot) and robot.feet and not robot.fixed_base:
        logging.getLogger(__name__).warning(
            "controller: no contacts are given: nothing holds the feet of %s, it floats; "
            'contacts=wbc.support(snapshot, "all") makes it stand, contacts=() means to float',
            robot.name,
        )
    return ()


def warn_outside_limits(snapshot: Snapshot) -> bool:
    """Warn of joints far outside their limits: q may be in degrees, or in another order.

    Returns whether there are any.
    """
    past = snapshot.robot.limits.past(snapshot.joint_positions)
    far = np.flatnonzero(past > FAR_OUTSIDE)
    if far.size:
        worst = int(past.argmax())
        logging.getLogger(__name__).warning(
            "controller: %s begins with %d of its joints outside their limits, %s by %.3g rad or m:"
            " is q in degrees, or in another order than robot.joint_names?",
            *(snapshot.robot.name, far.size, snapshot.robot.joint_names[worst], past[worst]),
        )
    return bool(far.size)


def warn_far_targets(tasks: Sequence[Task], errors: Mapping[str, Array]) -> None:
    """Warn of targets that no robot reaches: they may be in mm, or in degrees.

    ``errors``: of each task, by its name, in its own units.
    """
    for task in tasks:
        if not np.any(task.weight):  # switched off, such as a walker's swing foot that stands
            continue
        sizes = tuple(zip(np.abs(errors[task.name]).tolist(), task.units, strict=False))
        for unit, farthest, other in (("m", FAR_LENGTH, "mm"), ("rad", FAR_ANGLE, "degrees")):
            off = max((size for size, own in sizes if own == unit), default=0.0)
            if off > farthest:
                logging.getLogger(__name__).warning(
                    "controller: the target of %s is %.3g %s away: is it in %s?",
                    *(task, off, unit, other),
                )


def warn_displaced(snapshot: Snapshot, contacts: Sequence[Task]) -> None:
    """Warn of contacts that are not at their anchors."""
    away = displaced(snapshot, contacts)
    if away:
        told = ", ".join(f"{name!r} by {1e3 * by:.3g} mm" for name, by in away.items())
        logging.getLogger(__name__).warning(
            "controller: contacts of %s are not where they are to be held: %s; they are moved there"
            " at once. Make them of the measured state: wbc.support(snapshot, ...)",
            *(snapshot.robot.name, told),
        )


def warn_forceless(tasks: Sequence[ForceTask], contacts: Sequence[Task]) -> None:
    """Warn of tasks about the forces of contacts at frames that are neither held nor soles."""
    held = [contact.name for contact in contacts]
    for task in tasks:
        frames: tuple[str, ...] = ()
        if isinstance(task, ForceRateTask | LoadShareTask):
            frames = task.frames
        elif isinstance(task, ContactForceTask | CopTask) and task.frame is not None:
            frames = (task.frame,)
        soles = {foot.frame for foot in task.robot.feet.values()}
        absent = [frame for frame in frames if frame not in soles.union(held)]
        if absent:
            logging.getLogger(__name__).warning(
                "controller: %s is about the forces of contacts at %s, where there is none: it has"
                " no effect there (contacts: %s)",
                *(task, ", ".join(absent), ", ".join(held) or "none"),
            )


def warn_dependent(snapshot: Snapshot, contacts: Sequence[Task]) -> None:
    """Warn of contacts whose rows are dependent: legs cannot move the soles against each other so.

    As of two soles on legs without a joint that rolls them, or turns them.
    """
    held = independent_rows([one for one in contacts if isinstance(one, Contact)])
    if len(held.contacts) < 2:
        return
    jacobians = [one.residual(snapshot).jacobian for one in held.contacts]
    chosen = zip(jacobians, held.row_selections, strict=True)
    J = np.concatenate([rows if own is None else rows[own] for rows, own in chosen])
    combinations, sizes, _ = np.linalg.svd(J)
    rank = int(np.count_nonzero(sizes > DEPENDENT * sizes[0]))
    if rank == len(J):
        return
    parts = np.linalg.norm(combinations[:, rank:], axis=1)
    rows = [label for label, part in zip(held.labels, parts, strict=True) if part > LARGE_PART]
    logging.getLogger(__name__).warning(
        "controller: the joints of %s cannot move %s independently, as its contacts ask: where the"
        " ground yields a little, accelerations and torques are huge. Hold less, such as soles that"
        " legs cannot roll by a LineContact (type: line)",
        *(snapshot.robot.name, listed(rows, 8)),
    )


def warn_competing(tasks: Sequence[Task], snapshot: Snapshot, velocity: Array, dt: float) -> bool:
    """Warn of tasks that compete at rest at different gains; return whether any do."""
    gains = competing_tasks(tasks, snapshot, velocity, dt)
    if gains:
        told = ", ".join(f"{name!r} (gain {gain:.3g})" for name, gain in gains.items())
        logging.getLogger(__name__).warning(
            "controller: at rest, and off their targets: %s; there gains act as weights. Equal"
            " gains, or weighs_error=True, give what the weights say",
            told,
        )
    return bool(gains)


def refuse_positional(more: Sequence[object]) -> None:
    """Raise InvalidInputError if there are further positional arguments."""
    if more:
        raise InvalidInputError(
            "controller: a robot and a list of tasks, and all else by name, as in contacts=...,"
            f" limits=...; got {', '.join(map(shown, more))} without one"
        )


def refuse_weightless(tasks: Sequence[Task]) -> None:
    """Raise InvalidInputError if a task has no weight."""
    for task in tasks:
        if not task.weight.any():
            raise InvalidInputError(
                f"controller: {task} has no weight and would do nothing; leave it out, or give it"
                " a weight (switch_off() of a task does that later)"
            )


def warn_unused_gains(tasks: Sequence[Task], torques: bool) -> None:
    """Warn of tasks with gains for the other level, and none for this one; of a threshold, too."""
    for task in tasks:
        if torques and task.singular_threshold:
            logging.getLogger(__name__).warning(
                "controller: singular_threshold of %s has no effect at the torque level", task
            )
        law = task.law
        first = (law.gain, law.gain_per_second) != (DEFAULT_LAW.gain, DEFAULT_LAW.gain_per_second)
        second = task.acceleration_law != AccelerationLaw()
        if first != second and second != torques:
            unused, level, used = LEVEL_GAINS[torques]
            logging.getLogger(__name__).warning(
                "controller: %s of %s has no effect at the %s level; give %s",
                *(unused, task, level, used),
            )


def motion_and_forces(
    tasks: Sequence[Task], controller: str, decides_forces: bool
) -> tuple[tuple[Task, ...], tuple[ForceTask, ...]]:
    """Return the tasks about motion and those about forces.

    Raises InvalidInputError: a task about forces, and a controller that ``decides_forces`` none;
    the message names both.
    """
    forces = tuple(task for task in tasks if isinstance(task, ForceTask))
    if forces and not decides_forces:
        raise InvalidInputError(
            f"controller: {forces[0]} is a {type(forces[0]).__name__}, about forces, which a"
            f" {controller} does not decide; give it to a TorqueController, or leave it out"
        )
    return tuple(task for task in tasks if not isinstance(task, ForceTask)), forces


def check_parts(
    robot: Robot,
    tasks: Sequence[Task],
    contacts: Sequence[Task],
    limits: Limits | None,
    constraints: Sequence[Constraint],
    slack: Mapping[str, float] = NO_SLACK,
) -> None:
    """Refuse what is no part of a controller, parts of another robot, and names given twice.

    Raises InvalidInputError: the message says which part, and what it should be; UnknownNameError:
    ``slack`` of what is not there.
    """
    check_robot("controller", robot)
    for kind, given, wanted in (
        ("tasks", tasks, Task),
        ("contacts", contacts, Task),
        ("constraints", constraints, Constraint),
    ):
        check_list(kind, given, wanted)
    for contact in contacts:
        if isinstance(contact, ForceTask):
            raise InvalidInputError(
                f"controller, contacts: {contact} is about forces and holds nothing; it is a task"
            )
    if limits is not None and not isinstance(limits, Limits):
        raise InvalidInputError(f"controller, limits: expected Limits or None, got {shown(limits)}")
    if limits is not None and type(limits).box is not Limits.box:
        raise InvalidInputError(
            f"controller, limits: box() of a {type(limits).__name__} would not be asked; assign"
            " speed, acceleration or speed_up, or write a Constraint with rows() of your own"
        )
    if not len(tasks):
        raise InvalidInputError("controller: no task given; there is nothing to do")
    parts: list[Task | Constraint | Limits] = [*tasks, *contacts, *constraints]
    for part in [*parts, *([limits] if limits else [])]:
        missing = "robot" if getattr(part, "robot", None) is None else "rows"
        if missing == "robot" or (isinstance(part, Task) and not hasattr(part, "rows")):
            how = "super().__init__(robot, ...)" if isinstance(part, Task) else "self.robot = robot"
            raise InvalidInputError(
                f"controller: a {type(part).__name__} has no {missing}; write {how} in its __init__"
            )
        if part.robot is not robot:
            raise InvalidInputError(f"controller: {part!r} was made for another robot object")
    for constraint in constraints:
        if not isinstance(getattr(constraint, "name", None), str):
            raise InvalidInputError(
                f"controller: a {type(constraint).__name__} has no name, which diagnostics call it"
                " by; set self.name, a word, when it is made"
            )
    for task in (*tasks, *contacts):
        for name in ("reported_rows", "units"):  # in this order: units are those of the rows
            words = getattr(task, name)
            if not isinstance(words, tuple | list) or not all(isinstance(w, str) for w in words):
                raise InvalidInputError(
                    f"controller: {task}: {name}, a property: expected a tuple of words, got"
                    f" {shown(words)}"
                )
    for kind, names in (
        ("task", [task.name for task in tasks]),
        ("contact", [contact.name for contact in contacts]),
    ):
        for name in names:
            if names.count(name) > 1:
                raise InvalidInputError(f"controller: two {kind}s are called {name!r}")
    Slacks(slack, mechanics_of(robot, contacts), constraints)


def check_snapshot(robot: Robot, snapshot: object, more: object = None) -> None:
    """Raise unless ``snapshot`` is one of this robot object, and there is no ``more``.

    Raises InvalidInputError: the message says what was given.
    """
    if more is not None or not isinstance(snapshot, Snapshot):
        given = [snapshot] if more is None else [snapshot, more]
        raise InvalidInputError(
            f"controller: expected a snapshot of {robot.name}, which has q and v: write"
            f" robot.snapshot(q, v); got {', '.join(map(shown, given))}"
        )
    if snapshot.robot is not robot:
        raise InvalidInputError(
            f"controller: expected a snapshot of {robot.name}, made by the robot object "
            "that the controller was made with (a copy or a pickle of a controller has its own: "
            f"controller.robot.snapshot(q, v)); got {shown(snapshot)}"
        )


def validate_returns(
    snapshot: Snapshot,
    dt: float,
    tasks: Sequence[Task],
    contacts: Sequence[Task],
    constraints: Sequence[Constraint],
) -> None:
    """Raise an error that names the part whose return value broke a tick; up to a millisecond.

    Raises InvalidInputError: a task's residual or a constraint's rows are none, or not finite; the
    message names it.
    """
    for task in (*tasks, *contacts):
        validation.check_residual(task, snapshot)
    for constraint in constraints:
        check_rows(constraint, snapshot, dt)


def check_list(kind: str, given: Any, wanted: type) -> None:
    """Raise InvalidInputError if ``given`` is not a list of parts."""
    what = "Contact objects" if kind == "contacts" else f"{wanted.__name__} objects"
    if isinstance(given, wanted):
        raise InvalidInputError(f"controller, {kind}: expected a list, got one; write [...]")
    hint = '; wbc.support(snapshot, "all") makes contacts' if kind == "contacts" else ""
    if isinstance(given, str) or not isinstance(given, Collection):
        raise InvalidInputError(
            f"controller, {kind}: expected a list of {what}, got {given!r}{hint}"
        )
    for one in given:
        if not isinstance(one, wanted):
            raise InvalidInputError(
                f"controller, {kind}: expected {what}, but the list has {one!r}{hint}"
            )
