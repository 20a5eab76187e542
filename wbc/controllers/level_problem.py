"""What the levels of one tick have in common."""

from __future__ import annotations

from typing import NamedTuple

from wbc.controllers.plan import Assembled, Physics
from wbc.laws import Rows
from wbc.robot import Snapshot
from wbc.validate import Array

Box = tuple[Array, Array]


class LevelProblem(NamedTuple):
    """Everything that the levels of one tick have in common.

    Attributes
    ----------
    rows:
        One for each task, for each soft contact, then for each task about forces.
    contacts:
        Rows of the contacts that are met exactly.
    box:
        Bounds (nv,), (nv,) on the velocity.
    recovery:
        Rows that move joints back into range, or None.
    assembled:
        The QP of the only level in ``box``, where the native core made it: no rows then.
    """

    snapshot: Snapshot
    rows: list[Rows]
    contacts: list[Rows]
    physics: Physics
    box: Box
    recovery: Rows | None
    assembled: Assembled | None = None
