"""What is to be solved: tasks, contacts, limits, support and capsules, checked once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wbc.constraints import Contact, Limits, PointContact
from wbc.controllers.shaping.capsules import WORLD, CapsulePair
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.sole import convex_hull
from wbc.tasks import Task
from wbc.validate import Array, finite_number


@dataclass(frozen=True, eq=False)
class ShapingProblem:
    """The parts of a global shaping problem.

    Attributes
    ----------
    robot, tasks, contacts, limits:
        As for :class:`~wbc.controllers.kinematic.KinematicController`.
    support:
        Half-planes (k, 3), rows (n_x, n_y, d), that the CoM must be in: n . com_xy <= d; or None.
    capsules:
        Pairs that must stay apart.
    """

    robot: Robot
    tasks: tuple[Task, ...]
    contacts: tuple[Contact, ...]
    limits: Limits
    support: Array | None
    capsules: tuple[CapsulePair, ...]

    @property
    def anchor(self) -> Contact | None:
        """The first contact that holds a frame entirely: the base then follows from the joints."""
        return next((c for c in self.contacts if not isinstance(c, PointContact)), None)


def check_parts(
    robot: Robot,
    tasks: Sequence[Task],
    contacts: Sequence[Contact],
    limits: Limits,
    capsules: Sequence[CapsulePair],
) -> None:
    """Refuse parts of another robot, names given twice, several levels, and no task at all.

    Raises
    ------
    InvalidInputError
        One of these; the message names the part.
    UnknownNameError
        A capsule's frame does not exist.
    """
    if not tasks:
        raise InvalidInputError("global shaping: no task given; there is nothing to optimise")
    parts: list[Task | Contact | Limits] = [*tasks, *contacts, limits]
    for part in parts:
        if part.robot is not robot:
            raise InvalidInputError(f"global shaping: {part!r} was made for another robot object")
    names = [task.name for task in tasks]
    for name in names:
        if names.count(name) > 1:
            raise InvalidInputError(f"global shaping: two tasks are called {name!r}")
    levels = sorted({task.priority for task in tasks})
    if len(levels) > 1:
        raise InvalidInputError(
            f"global shaping: tasks have priorities {levels}; it weighs tasks against each other"
            " within one level. Give all tasks the same priority"
        )
    for pair in capsules:
        for frame in (pair.frame_a, pair.frame_b):
            if frame != WORLD:
                robot.frame_id(frame)


def support_half_planes(robot: Robot, contacts: Sequence[Contact], margin: float) -> Array:
    """Return the half-planes (k, 3) of the polygon spanned by the held feet, moved inwards.

    Raises
    ------
    InvalidInputError
        No held frame is a foot's sole, or the margin leaves nothing of the polygon.
    """
    margin = finite_number("global shaping, support_margin", margin, least=0.0)
    soles = {foot.frame: foot for foot in robot.feet.values()}
    held = [c for c in contacts if c.frame in soles and not isinstance(c, PointContact)]
    if not held:
        raise InvalidInputError(
            "global shaping, support_margin: no contact holds a foot's sole; without support there"
            " is no polygon to stay over"
        )
    corners = convex_hull(
        np.concatenate(
            [
                soles[contact.frame].polygon @ contact.rotation[:2, :2].T + contact.position[:2]
                for contact in held
            ]
        )
    )
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    normals = np.column_stack((edges[:, 1], -edges[:, 0])) / lengths[:, None]  # outwards
    reach = np.einsum("ij,ij->i", normals, corners) - margin
    if (normals @ corners.mean(axis=0) > reach).any():
        raise InvalidInputError(
            f"global shaping, support_margin: {margin:g} m leaves nothing of the support polygon"
        )
    return np.column_stack((normals, reach))
