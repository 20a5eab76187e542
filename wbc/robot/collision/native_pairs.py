"""The nearest pairs of capsules in the native core; pairs of other shapes are handed on.

One call looks at the balls round all bodies and measures what may be among the nearest, as
:class:`~wbc.robot.collision.covers.Covers` does by arrays.
"""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from wbc.native import address
from wbc.robot.collision.covers import Covers
from wbc.robot.kernel import NativeState
from wbc.validate import Array

Index = NDArray[np.int64]


class _Pairs(ctypes.Structure):
    """``wbc_pairs`` of wbc/native/source/core.h."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("nv", "joints", "bodies", "pairs")),
        *((name, ctypes.c_void_p) for name in ("joint", "local", "size", "pair", "solid")),
    ]


class NativePairs:
    """Pairs of bodies as the core reads them; bodies that are moved are read where they are.

    Parameters
    ----------
    covers:
        Capsules and balls round the bodies.
    pairs:
        (N, 2) indices of bodies.
    solid:
        (N,) whether a body of the pair is no capsule.
    """

    def __init__(
        self, covers: Covers, joints: Index, pairs: Index, solid: NDArray[np.bool_]
    ) -> None:
        self._made_of = covers, joints, pairs, solid
        self._kept = joints, covers.local, covers.sizes, pairs, solid.astype(np.int64)
        self._counts = len(joints), len(pairs)
        self._addresses = list(map(address, self._kept))

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), self._made_of  # a copy reads its own arrays

    def nearest(self, state: NativeState, count: int) -> tuple[Index, Array] | None:
        """Return the ``count`` nearest pairs of capsules and all others that may be as near.

        Their numbers, increasing, and what is nearest (7, k), of solids between their covers. None
        where axes touch, or where there are not so many pairs of capsules.
        """
        bodies, pairs = self._counts
        scratch, found = np.empty(9 * (bodies + pairs)), np.empty(7 * pairs)
        chosen = np.empty(pairs, dtype=np.int64)
        struct = self._struct(state)
        arrays = scratch, chosen, found
        work, numbers, nearest = map(address, arrays)
        k = state.tree.core.wbc_nearest(
            ctypes.addressof(struct), address(state.array), count, work, numbers, nearest
        )
        return None if k < 0 else (chosen[:k], found[: 7 * k].reshape(7, k))

    def rows(self, state: NativeState, pairs: Index, normal: Array, point: Array) -> Array:
        """Return the derivatives (k, nv) of distances by v.

        Parameters
        ----------
        normal, point:
            (3, k): unit vectors from the second body to the first, and points on the first.
        """
        tree, out = state.tree, np.empty((len(pairs), state.tree.nv))
        struct = self._struct(state)
        arrays = [np.ascontiguousarray(array) for array in (pairs, normal, point)]
        chosen, n, p = map(address, arrays)
        where = ctypes.addressof(struct), tree.address, address(state.array)
        tree.core.wbc_pair_rows(*where, len(pairs), chosen, n, p, address(out))
        return out

    def _struct(self, state: NativeState) -> _Pairs:
        return _Pairs(state.tree.nv, state.tree.joints, *self._counts, *self._addresses)
