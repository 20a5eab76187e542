"""Collects the page's data from a controller and its tick, in the sender's thread."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from wbc import tasks
from wbc.constraints import Contact, Obstacles, SelfCollision
from wbc.controllers import Controller, Tick
from wbc.controllers.tick import NEGLIGIBLE
from wbc.controllers.torque_tick import TorqueTick
from wbc.robot.collision import Shape
from wbc.robot.names import COM
from wbc.run.history import held_joints
from wbc.validate import Array
from wbc.view.live.messages import ContactInfo, ControllerInfo, PairsInfo, TaskInfo, TickInfo
from wbc.view.live.target_controls import target_of

KINDS: Mapping[type[tasks.Task], str] = {
    tasks.ComTask: "com",
    tasks.PositionTask: "position",
    tasks.OrientationTask: "orientation",
    tasks.PoseTask: "pose",
    tasks.AxisTask: "axis",
    tasks.InertiaTask: "inertia",
    tasks.PrincipalInertiaTask: "principal",
}


def controller_info(controller: Controller) -> ControllerInfo:
    """Return a controller's tasks, contacts and constraints."""
    held = (one for one in controller.contacts if isinstance(one, Contact))
    margins = (_pairs(one) for one in controller.constraints)
    return ControllerInfo(
        dt=controller.dt,
        tasks=tuple(_task(task) for task in controller.tasks),
        contacts=tuple(ContactInfo(one.frame, one.friction) for one in held),
        pairs=tuple(one for one in margins if one is not None),
    )


def _kind(task: tasks.Task) -> str:
    # Sliders and ellipsoids are about the CoM.
    if isinstance(task, tasks.InertiaTask) and task.about != COM:
        return "other"
    return next((kind for type_, kind in KINDS.items() if isinstance(task, type_)), "other")


def _task(task: tasks.Task) -> TaskInfo:
    frame = str(getattr(task, "frame", ""))
    return TaskInfo(task.name, _kind(task), frame, task.rows, task.units)


def _pairs(constraint: object) -> PairsInfo | None:
    if not isinstance(constraint, SelfCollision | Obstacles):
        return None
    model, obstacles = constraint.model, tuple[tuple[str, Shape], ...]()
    pairs = tuple((a, b) for a, b in model.pairs.tolist())
    if isinstance(constraint, SelfCollision):
        margins = constraint.margins
    else:
        margins = np.full(len(pairs), constraint.margin)
        obstacles = tuple((one.name, one.shape) for one in constraint.obstacles)
    return PairsInfo(constraint.name, model.bodies, pairs, margins, obstacles)


def targets_of(controller: Controller) -> dict[str, tuple[Array, ...]]:
    """Return the targets of the tasks whose kind the page knows, by name."""
    return {task.name: target_of(task) for task in controller.tasks if _kind(task) != "other"}


def obstacles_of(controller: Controller) -> dict[str, tuple[Array, Array]]:
    """Return the obstacles' rotations and origins, by name."""
    known = (one for one in controller.constraints if isinstance(one, Obstacles))
    return {one.name: (one.rotation, one.origin) for around in known for one in around.obstacles}


def tick_info(tick: Tick, seconds: float | None = None) -> TickInfo:
    """Return the results of a tick; ``seconds``: the whole loop's time."""
    strongest = sorted(held_joints(tick), key=lambda one: -one.pull)
    told = TickInfo(
        ok=tick.ok,
        report="solved" if tick.ok else tick.report(),
        seconds=tick.times.total if seconds is None else seconds,
        solve=tick.times.solve,
        step_scale=tick.step_scale,
        errors=tick.errors,
        active=tick.active,
        at_limit=tuple(f"{one.name} {one.side}" for one in strongest),
        relaxed={name: by for name, by in tick.slack.items() if abs(by) > NEGLIGIBLE},
    )
    if not isinstance(tick, TorqueTick):
        return told
    forces, wrenches = dict(tick.forces), dict(tick.wrenches)
    return replace(told, forces=forces, acceleration=tick.acceleration, wrenches=wrenches)
