"""The margin between a robot's bodies as the native core reads it: its rows and its look-ahead."""

from __future__ import annotations

import ctypes
import operator
from collections.abc import Sequence

import numpy as np

from wbc.constraints.collision import SelfCollision, WatchedPairs
from wbc.constraints.rows import Constraint, take
from wbc.controllers.slack import Slacks
from wbc.native import address
from wbc.robot.kernel import NativeTree
from wbc.validate import Array


class _Margin(ctypes.Structure):
    """``wbc_margin`` of wbc/native/source/core.h."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("of", "kept", "shorter", "acceleration")),
        ("rows", ctypes.c_int64),
        *((name, ctypes.c_double) for name in ("deceleration", "gain", "recovery")),
        ("recovery_speed", ctypes.c_double),
    ]


class NativeMargin:
    """What the core needs of a self-collision constraint.

    Attributes
    ----------
    rows:
        How many pairs get one.
    address:
        Where the core's structure lies.
    """

    def __init__(self, constraint: SelfCollision, known: WatchedPairs, tree: NativeTree) -> None:
        self._constraint, self._known = constraint, known
        self._labels = constraint.model.labels
        self.bodies, self.pairs = known.pairs.counts
        self.rows = min(known.rows, self.pairs)
        law = known.braking
        acceleration = known.acceleration
        arrays = known.kept, known.shorter
        self._kept = known.pairs.struct(tree), arrays, acceleration
        reached = 0 if acceleration is None else address(acceleration)
        places = ctypes.addressof(self._kept[0]), *map(address, arrays), reached
        numbers = law.deceleration, law.gain, law.recovery, law.recovery_speed
        self._struct = _Margin(*places, self.rows, *numbers)
        self.address = ctypes.addressof(self._struct)

    @classmethod
    def of(cls, constraint: SelfCollision, tree: NativeTree) -> NativeMargin | None:
        """Return it, or None: bodies that the core does not know, or none."""
        known = constraint.watched()
        return None if known is None else cls(constraint, known, tree)

    def serves(self) -> bool:
        """Whether the constraint is still as it was read."""
        now = self._constraint.watched()
        return now is not None and all(map(operator.is_, now, self._known))

    def labels(self, chosen: Array) -> tuple[str, ...]:
        """Return the labels of rows, from the numbers of their pairs."""
        return take(self._labels, chosen.astype(np.int64))


def only_self_collision(constraints: Sequence[Constraint], slacks: Slacks) -> SelfCollision | None:
    """Return the only constraint if it is one that the core knows, and may not give way."""
    if len(constraints) != 1:
        return None
    (one,) = constraints
    return one if type(one) is SelfCollision and slacks.is_hard(one.name) else None
