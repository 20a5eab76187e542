"""The margin between a robot's bodies as the native core reads it: its rows and its look-ahead."""

from __future__ import annotations

import operator
from collections.abc import Sequence

import numpy as np

from wbc.constraints.collision import SelfCollision, WatchedPairs
from wbc.constraints.rows import Constraint, take
from wbc.controllers.slack import Slacks
from wbc.native import ffi, pointer
from wbc.robot.kernel import NativeTree
from wbc.validate import Array


class NativeMargin:
    """What the core needs of a self-collision constraint.

    Attributes
    ----------
    rows:
        How many pairs get one.
    struct:
        The core's structure, a pointer to it.
    known:
        What is kept apart, and how.
    watched, arrays:
        What it points at; the arrays by the names of ``wbc_margin`` in source/core.h.
    """

    def __init__(self, constraint: SelfCollision, known: WatchedPairs, tree: NativeTree) -> None:
        self._constraint, self.known = constraint, known
        self._labels = constraint.model.labels
        self.bodies, self.pairs = known.pairs.counts
        self.rows = min(known.rows, self.pairs)
        law, self.watched = known.braking, known.pairs.struct(tree)
        self.arrays = {"kept": known.kept}
        if known.acceleration is not None:
            self.arrays["acceleration"] = known.acceleration
        self.struct = ffi.new("wbc_margin *", {"of": self.watched, "rows": self.rows})
        for name, array in self.arrays.items():
            setattr(self.struct, name, pointer(array))
        for name in ("deceleration", "gain", "recovery", "recovery_speed"):
            setattr(self.struct, name, getattr(law, name))

    @classmethod
    def of(cls, constraint: SelfCollision, tree: NativeTree) -> NativeMargin | None:
        """Return it, or None: bodies that the core does not know, or none."""
        known = constraint.watched()
        return None if known is None else cls(constraint, known, tree)

    def serves(self) -> bool:
        """Whether the constraint is still as it was read."""
        now = self._constraint.watched()
        return now is not None and all(map(operator.is_, now, self.known))

    def labels(self, chosen: Array) -> tuple[str, ...]:
        """Return the labels of rows, from the numbers of their pairs."""
        return take(self._labels, chosen.astype(np.int64))


def only_self_collision(constraints: Sequence[Constraint], slacks: Slacks) -> SelfCollision | None:
    """Return the only constraint if it is one that the core knows, and may not give way."""
    if len(constraints) != 1:
        return None
    (one,) = constraints
    return one if type(one) is SelfCollision and slacks.is_hard(one.name) else None
