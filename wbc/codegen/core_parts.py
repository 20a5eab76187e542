"""What of a controller the native core does not know, by name: there is no Python to hand it to."""

from __future__ import annotations

from typing import NamedTuple

from wbc.constraints.collision import SelfCollision
from wbc.controllers import Controller
from wbc.controllers.blocks import native_rows_of
from wbc.controllers.core_plan import TOLERANCE, CorePlan, core_solves
from wbc.controllers.torque import TorqueController
from wbc.errors import WbcError
from wbc.native.rows import Kind
from wbc.qp.active_set import NAME, ActiveSet
from wbc.robot.names import COM
from wbc.tasks import InertiaTask
from wbc.tasks.force_task import ForceTask
from wbc.tasks.task import Task


class CodegenError(WbcError):
    """A controller that cannot be exported as C; the message names the unsupported part."""


class CoreParts(NamedTuple):
    """What the core computes ticks by, and the settings that it solves QPs with."""

    plan: CorePlan
    solver: ActiveSet


def core_parts(controller: Controller) -> CoreParts:
    """Return what the core computes every tick of a controller by."""
    reason, solver = _unsupported(controller), controller.backend
    if reason is None and isinstance(solver, ActiveSet):
        return CoreParts(controller.core, solver)
    raise CodegenError(f"the exported C does not know {reason}")


def _unsupported(controller: Controller) -> str | None:
    """Return what the core does not know, in words; None if nothing is found."""
    if type(controller.backend) is not ActiveSet:
        return f"the solver {controller.backend.name!r}; set controller.solver to {NAME}"
    if not core_solves(controller.backend):
        return f"an eps above {TOLERANCE:g}; set controller.eps to that or less"
    if len(controller.plan.levels) > 1:
        lower = [repr(task.name) for task in controller.tasks if task.priority > 0]
        return f"levels of priority ({', '.join(lower)}); give weights instead"
    if controller.plan.soft:
        names = ", ".join(repr(one.name) for one in controller.plan.soft)
        return f"contacts that may give way: {names}; leave their slack out"
    if controller.limits is not None and controller.limits.braking != "free":
        return f"the braking {controller.limits.braking!r} of limits; set it to free"
    if controller.robot.loops:
        return f"closed loops: {', '.join(map(repr, controller.robot.loops))}"
    if controller.deadline is not None:
        return "a deadline, as it reads no clock; leave controller.deadline out"
    torque = isinstance(controller, TorqueController)
    if isinstance(controller, TorqueController) and controller.delay:
        return "a delay to predict over; leave controller.delay out"
    if isinstance(controller, TorqueController) and controller.friction_compensation:
        return "dry friction to make up for; leave controller.friction_compensation out"
    if torque and controller.robot.passive:
        passive = controller.robot.passive
        owners = {**passive.springs, **passive.curved_damping}, (x.frame for x in passive.lifts)
        return (
            "springs, curved damping and gravity compensation"
            f" ({', '.join(name for one in owners for name in one)}); leave them out of the"
            " robot's file, or use level: velocity"
        )
    for task in (*controller.tasks, *controller.plan.held.contacts):
        if (unknown := _unknown_of(task, torque)) is not None:
            return unknown
    # The core has a margin where the only constraint is a self-collision that it knows.
    if controller.constraints and controller.core.margin is None:
        for one in controller.constraints:
            if isinstance(one, SelfCollision) and one.watched() is None:
                return f"a self_collision, {one.name!r}, that watches no bodies; leave it out"
        names = ", ".join(repr(one.name) for one in controller.constraints)
        return f"constraints ({names}) but one self_collision without slack; leave them out"
    return None


def _unknown_of(task: Task, torque: bool) -> str | None:
    """Return what the core does not know of a task, in words; None if nothing is found."""
    what, rows = f"task {task.name!r}", native_rows_of(task, torque)
    if isinstance(task, ForceTask):
        return f"{what}, which is about forces"
    if not torque and task.singular_threshold > 0.0:
        return f"the singular_threshold of {what}; leave it out"
    if isinstance(task, InertiaTask):
        if not torque and task.second_order:  # rows are kept for that, which C has no room for
            return f"second_order of {what}; leave it out"
        if task.about != COM:
            return f"an inertia about {task.about!r}, as {what} has it; leave about out"
    if rows is None and task.native() is None:
        return f"{what}, a {type(task).__name__} of a kind that is computed in Python"
    if rows is None:
        return f"the law of {what}"
    if any(one.kind == Kind.RELATIVE for one in rows):  # whose targets exported C cannot set
        return f"the pose of {what}, as it is seen from another frame"
    return None
