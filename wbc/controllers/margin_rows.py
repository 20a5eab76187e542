"""The self-collision margin as the native core reads it: for its rows and its look-ahead."""

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
    """A self-collision constraint in the core.

    ``rows``: number of pairs with a row.
    ``struct``: pointer to the ``wbc_margin``.
    ``known``: the pairs, their distances and braking.
    ``watched``, ``arrays``: kept alive for the struct; the arrays by the names of ``wbc_margin`` in
    source/core.h.
    """

    def __init__(self, constraint: SelfCollision, known: WatchedPairs, tree: NativeTree) -> None:
        self._constraint, self.known = constraint, known
        self._labels = constraint.model.labels
        self.bodies, self.pairs = known.pairs.counts
        self.rows = min(known.rows, self.pairs)
        law, self.watched = known.braking, known.pairs.struct(tree)
        self.arrays = {"kept": known.min_distances}
        if known.acceleration is not None:
            self.arrays["acceleration"] = known.acceleration
        self.struct = ffi.new("wbc_margin *", {"of": self.watched, "rows": self.rows})
        for name, array in self.arrays.items():
            setattr(self.struct, name, pointer(array))
        for name in ("deceleration", "gain", "recovery", "recovery_speed"):
            setattr(self.struct, name, getattr(law, name))

    @classmethod
    def of(cls, constraint: SelfCollision, tree: NativeTree) -> NativeMargin | None:
        """Return it, or None if there are no bodies, or some that the core does not know."""
        known = constraint.watched()
        return None if known is None else cls(constraint, known, tree)

    def is_current(self) -> bool:
        """Return whether the constraint is unchanged since."""
        now = self._constraint.watched()
        return now is not None and all(map(operator.is_, now, self.known))

    def labels(self, chosen: Array) -> tuple[str, ...]:
        """Return the labels of rows, from the numbers of their pairs."""
        return take(self._labels, chosen.astype(np.int64))


def only_self_collision(constraints: Sequence[Constraint], slacks: Slacks) -> SelfCollision | None:
    """Return the constraint if it is the only one, hard, and known to the core."""
    if len(constraints) != 1:
        return None
    (one,) = constraints
    return one if type(one) is SelfCollision and slacks.is_hard(one.name) else None
