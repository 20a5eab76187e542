"""What a search over postures asks of a problem, beyond what every problem must be."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wbc.constraints import Limits
from wbc.errors import InvalidInputError
from wbc.problem.controller_specs import GlobalSpec
from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.spec import ProblemSpec
from wbc.problem.task_specs import MomentumSpec

if TYPE_CHECKING:
    from wbc.controllers.shaping import GlobalShaping
    from wbc.problem.build import Parts


def check_global(spec: ProblemSpec, mistakes: Mistakes) -> None:
    """Note what a search over postures has no use for: all that is about time or velocity."""
    if spec.phases is not None:
        with mistakes.at("phases"):
            raise InvalidInputError(
                "method global looks for one posture and moves there; leave the phases out, or "
                "give another controller.method"
            )
    used = {name: task for name, task in spec.tasks.items() if task.active}
    level = next((task.priority for task in used.values()), 0)
    for name, task in used.items():
        with mistakes.at("tasks", name, "type"):
            if isinstance(task, MomentumSpec):
                raise InvalidInputError(
                    "method global: momentum is about velocities, a posture has none; "
                    "give active: false, or another controller.method"
                )
        with mistakes.at("tasks", name, "priority"):
            if task.priority != level:
                raise InvalidInputError(
                    "method global weighs tasks against each other within one level; "
                    f"give all tasks the same priority ({next(iter(used))!r} has {level})"
                )
        with mistakes.at("tasks", name, "ramp"):
            if getattr(task, "ramp", None) is not None:
                raise InvalidInputError(
                    "method global looks for the posture that meets the target itself, and sets "
                    "its own pace on the way there; leave this out"
                )


def global_shaping(parts: Parts, spec: ProblemSpec, controller: GlobalSpec) -> GlobalShaping:
    """Return the search that a problem describes, over the tasks that are in use.

    Raises
    ------
    Misplaced
        A support margin without a sole to stand on, or one that leaves nothing of it.
    """
    # Only now: a problem without a search need not wait for CasADi to load.
    from wbc.controllers.shaping import GlobalShaping

    limits = parts.limits
    if limits is None:
        limits = Limits(parts.robot, position=False, velocity=None)
    try:
        return GlobalShaping(
            parts.robot,
            [task for task in parts.tasks if spec.tasks[task.name].active],
            parts.contacts,
            limits,
            controller.support_margin,
        )
    except InvalidInputError as error:
        head = "global shaping, support_margin: "
        if not str(error).startswith(head):
            raise
        raise Misplaced(str(error).removeprefix(head), "support_margin") from error
