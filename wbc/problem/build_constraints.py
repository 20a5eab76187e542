"""From the constraints of a problem file to the objects that give rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wbc.constraints import (
    ComSupport,
    Constraint,
    Contact,
    Limits,
    Obstacles,
    PositionBox,
    SelfCollision,
)
from wbc.problem.constraint_specs import (
    BoxSpec,
    ComSupportSpec,
    ConstraintSpec,
    ObstacleSpec,
    ObstaclesSpec,
    SelfCollisionSpec,
)
from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.robot import Snapshot
from wbc.robot.collision import Obstacle
from wbc.run.standing import Standing
from wbc.validate import Array

SHAPES = ("sphere", "capsule", "box", "half_space")


class Surroundings:
    """What a robot must respect beside its limits, ready for any contacts and any time.

    Attributes
    ----------
    fixed:
        Constraints that are the same in every phase.
    balances:
        CoM supports by name; made anew for the feet that stand.
    moving:
        Obstacles that move: where they are at the start (3,) and their velocities (3,).
    slack:
        Weights of the constraints that may give way, by name.
    """

    def __init__(self) -> None:
        self.fixed: list[Constraint] = []
        self.balances: dict[str, ComSupportSpec] = {}
        self.moving: list[tuple[Obstacle, Array, Array]] = []
        self.slack: dict[str, float] = {}

    def around(self, snapshot: Snapshot, contacts: Sequence[Contact]) -> list[Constraint]:
        """Return the constraints for the feet that ``contacts`` hold, where they are now.

        Raises
        ------
        InvalidInputError
            A margin that leaves nothing of a support polygon.
        """
        found = list(self.fixed)
        for name, spec in self.balances.items():
            feet = spec.feet or Standing.on("", contacts).feet
            if feet:
                balance = ComSupport.over(snapshot, feet, margin=spec.margin)
                balance.name = name
                found.append(balance)
        return found

    def slack_of(self, constraints: Sequence[Constraint]) -> dict[str, float]:
        """Return the slack weights of those that may give way."""
        names = [constraint.name for constraint in constraints]
        return {name: weight for name, weight in self.slack.items() if name in names}

    def move_to(self, time: float) -> None:
        """Put moving obstacles where they are at ``time`` [s]."""
        for obstacle, start, velocity in self.moving:
            obstacle.move(np.eye(3), start + time * velocity, velocity)


def surroundings(
    specs: Mapping[str, ConstraintSpec], start: Snapshot, limits: Limits | None, mistakes: Mistakes
) -> Surroundings:
    """Return the constraints of a problem; mistakes are noted at their places."""
    made = Surroundings()
    for name, spec in specs.items():
        with mistakes.at("constraints", name):
            if isinstance(spec, ComSupportSpec):
                made.balances[name] = spec
                if spec.feet is not None:
                    ComSupport.over(start, spec.feet, margin=spec.margin)
            else:
                constraint = _constraint(spec, start, limits, made.moving)
                constraint.name = name
                made.fixed.append(constraint)
            if spec.slack is not None:
                made.slack[name] = spec.slack
    return made


def _constraint(
    spec: SelfCollisionSpec | ObstaclesSpec | BoxSpec,
    start: Snapshot,
    limits: Limits | None,
    moving: list[tuple[Obstacle, Array, Array]],
) -> Constraint:
    robot = start.robot
    if isinstance(spec, BoxSpec):
        lower = [-np.inf if end is None else end for end in spec.lower]
        upper = [np.inf if end is None else end for end in spec.upper]
        return PositionBox(robot, spec.frame, lower, upper, limits=limits)
    common: dict[str, Any] = {
        "margin": spec.margin,
        "pairs": spec.pairs,
        "fit": spec.fit,
        "limits": limits,
    }
    if isinstance(spec, SelfCollisionSpec):
        common |= {"include": spec.include, "exclude": spec.exclude}
        return SelfCollision(robot, **common)
    things = [_obstacle(name, thing) for name, thing in spec.things.items()]
    for obstacle, thing in zip(things, spec.things.values(), strict=True):
        place, velocity = np.array(thing.position), np.array(thing.velocity)
        obstacle.move(np.eye(3), place, velocity)
        if velocity.any():
            moving.append((obstacle, place, velocity))
    return Obstacles(robot, things, links=spec.links, **common)


def _obstacle(name: str, spec: ObstacleSpec) -> Obstacle:
    """Return an obstacle about the origin of its own frame."""
    shapes = spec.model_dump(include=set(SHAPES), exclude_none=True)
    if len(shapes) != 1:
        raise Misplaced(f"needs one of {', '.join(SHAPES)}, and only one", "things", name)
    centre = np.zeros(3)
    if spec.sphere is not None:
        return Obstacle.sphere(name, centre, spec.sphere)
    if spec.capsule is not None:
        radius, length = spec.capsule
        half = np.array((0.0, 0.0, 0.5 * length))
        return Obstacle.capsule(name, -half, half, radius)
    if spec.box is not None:
        return Obstacle.box(name, spec.box)
    return Obstacle.half_space(name, np.array(spec.half_space), 0.0)
