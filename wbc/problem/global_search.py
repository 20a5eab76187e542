"""Problems of method ``global``: their checks, and making the search over postures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from wbc.constraints import ComSupport, Contact, Limits
from wbc.errors import InvalidInputError
from wbc.problem.components import Parts
from wbc.problem.controller_spec import GlobalSpec
from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.spec import ProblemSpec
from wbc.robot import Snapshot
from wbc.run.phase_support import held_feet

if TYPE_CHECKING:
    from wbc.shaping import GlobalShaping


def check_global(spec: ProblemSpec, mistakes: Mistakes) -> None:
    """Note what a search over postures does not support: everything about time or velocity."""
    if spec.phases is not None:
        mistakes.note(
            ("phases",),
            "method global looks for one posture and moves there; leave the phases out, or "
            "give another controller.method",
        )
    for name, constraint in spec.constraints.items():
        for mistake in constraint.not_in_search():
            mistakes.note(("constraints", name), mistake)
    used = {name: task for name, task in spec.tasks.items() if task.active}
    level = next((task.priority for task in used.values()), 0)
    for name, task in used.items():
        if task.no_posture:
            remedy = "give active: false, or another controller.method"
            mistakes.note(("tasks", name, "type"), f"method global: {task.no_posture}; {remedy}")
        if task.priority != level:
            mistakes.note(
                ("tasks", name, "priority"),
                "method global weighs tasks against each other within one level; "
                f"give all tasks the same priority ({next(iter(used))!r} has {level})",
            )
        if getattr(task, "ramp", None) is not None:
            mistakes.note(
                ("tasks", name, "ramp"),
                "method global looks for the posture that meets the target itself, and sets "
                "its own pace on the way there; leave this out",
            )


def global_shaping(parts: Parts, spec: ProblemSpec, controller: GlobalSpec) -> GlobalShaping:
    """Return the search that a problem describes, over the tasks that are in use.

    It has all hard constraints; soft ones are left to the motion.

    Raises Misplaced: a support margin without a sole to stand on, or one that leaves nothing of it.
    """
    # Imported here: problems without a search need not load CasADi.
    from wbc.shaping import GlobalShaping

    limits = parts.limits
    if limits is None:
        limits = Limits(parts.robot, position=False, velocity=None)
    start = parts.robot.snapshot(parts.start)
    constraints_at = parts.surroundings.constraints_at(start, parts.contacts)
    soft = parts.surroundings.slack
    hard = [constraint for constraint in constraints_at if constraint.name not in soft]
    if controller.support_margin is not None:
        hard.append(_over_held_soles(start, parts.contacts, controller.support_margin))
    return GlobalShaping(
        parts.robot,
        [task for task in parts.tasks if spec.tasks[task.name].active],
        parts.contacts,
        limits,
        hard,
        controller.dt,
    )


def _over_held_soles(start: Snapshot, contacts: Sequence[Contact], margin: float) -> ComSupport:
    feet = held_feet(contacts)
    if not feet:
        raise Misplaced(
            "no contact holds a foot's sole; without support there is no polygon to stay over",
            "support_margin",
        )
    try:
        return ComSupport.over(start, feet, margin=margin)
    except InvalidInputError as error:
        raise Misplaced(str(error).removeprefix("com support, margin: "), "support_margin") from (
            error
        )
