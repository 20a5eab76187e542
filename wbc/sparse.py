"""Sparse matrices of CasADi expressions, by their entries."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.intp]


def summed(places: Places, values: ca.MX, size: int) -> ca.MX:
    """Return the vector (size, 1) of sums of values by place."""
    count = len(places)
    add = ca.DM.triplet(places.tolist(), list(range(count)), ca.DM.ones(count), size, count)
    return add @ values


def matrix_of(row: Places, column: Places, values: ca.MX, shape: tuple[int, int]) -> ca.MX:
    """Return the sparse matrix of values at places, sums where places are the same.

    Places outside are left out.
    """
    inside = np.flatnonzero((row < shape[0]) & (column < shape[1]))
    if not inside.size:
        return ca.MX(*shape)
    keys, order = np.unique(column[inside] * shape[0] + row[inside], return_inverse=True)
    # By columns, as CasADi stores it.
    pattern = ca.Sparsity.triplet(*shape, (keys % shape[0]).tolist(), (keys // shape[0]).tolist())
    return ca.MX(pattern, summed(order, values[inside.tolist()], keys.size))
