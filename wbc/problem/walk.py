"""A walk made of what a file describes: its walker, and who leads it by the commands."""

from __future__ import annotations

from functools import partial

import numpy as np

from wbc.gait import Walker, WalkingWeights
from wbc.gait.commanded import CommandedWalk
from wbc.problem.parts import Parts
from wbc.problem.walk_spec import WalkSpec
from wbc.run.ramps import MinimumJerk
from wbc.simulation import Plant


def walker_of(spec: WalkSpec, parts: Parts) -> Walker:
    """Return a walker at the start, with the problem's tasks, limits and constraints.

    Raises
    ------
    WbcError
        A robot that cannot walk, or settings that do not fit it.
    """
    start = parts.robot.snapshot(parts.start, np.zeros(parts.robot.nv))
    for one in parts.targeted:
        goal = one.goal(start, one.current(start))
        one.set_target(*MinimumJerk(goal, goal, 1.0, one.space).at(0.0))
    return Walker(
        parts.robot,
        spec.gait.settings,
        weights=WalkingWeights(**spec.gait.weights),
        posture=parts.start,
        friction=spec.controller.friction_cone,
        tasks=[one.task for one in parts.targeted if spec.tasks[one.task.name].active],
        constraints=parts.surroundings.around(start, parts.contacts),
        limits=parts.limits,
        solver=spec.controller.backend(),
        **spec.controller.settings,
    )


def commanded_walk(spec: WalkSpec, parts: Parts, plant: Plant) -> CommandedWalk:
    """Return what leads the walk; its feet feel the ground of ``plant``."""
    forces = partial(getattr, plant, "contact_forces") if spec.gait.feel else None
    commands = [command.timed for command in spec.gait.commands]
    walker = walker_of(spec, parts)
    if spec.gait.footsteps:
        start = parts.robot.snapshot(parts.start, np.zeros(parts.robot.nv))
        given = [one.footstep for one in spec.gait.footsteps]
        walker.follow(given, start, relative=spec.gait.relative)
    return CommandedWalk(walker, commands, forces, parts.surroundings.move_to)
