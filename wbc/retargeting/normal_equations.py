"""Normal equations in which only neighbouring frames are coupled: one band of a matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solveh_banded

from wbc.errors import SolverError
from wbc.native import doubles, lib, pointer
from wbc.validate import Array

SPAN = 3  # frames that are coupled


class NormalEquations:
    """Sums of squares in displacements (n, nv) of n frames, each coupled with the next three.

    Attributes
    ----------
    slope:
        (n, nv).
    """

    def __init__(self, count: int, nv: int) -> None:
        # LAPACK's lower band by columns: entry (i, j) of the matrix is [j, i - j].
        self._band = np.zeros((count, nv, (SPAN + 1) * nv))
        self.slope = np.zeros((count, nv))

    def add(self, *parts: Array, off: Array) -> None:
        """Add A_k d_k + B_k d_k+1 + ..., parts A, B, ... (m, r, nv), errors (m, r)."""
        (count, rows, nv), span = parts[0].shape, len(parts)
        J = np.empty((count, rows, span, nv))
        for k, part in enumerate(parts):
            J[:, :, k] = part
        given = pointer(J), pointer(np.ascontiguousarray(off))
        height, sums = self._band.shape[2], (doubles(self._band), doubles(self.slope))
        lib.wbc_add_normal_equations(count, nv, span, rows, *given, height, *sums)

    def add_differences(
        self, ways: Sequence[float], square: Array, slope: Array, first: int = 0
    ) -> None:
        """Add differences over frames of the coordinates from ``first`` on, one by one.

        Parameters
        ----------
        ways:
            Of the difference, such as (1, -2, 1).
        square, slope:
            Of each difference (m, k), by itself.
        """
        count, nv = len(slope), self.slope.shape[1]
        for i, a in enumerate(ways):
            self.slope[i : count + i, first:] += a * slope
            for j in range(i, len(ways)):
                self._band[i : count + i, first:, (j - i) * nv] += a * ways[j] * square

    def solved(self, more: Array, pull: Array) -> Array:
        """Return displacements (n, nv), with ``more`` and ``pull`` (n, nv) on diagonal and slope.

        Raises
        ------
        SolverError
            The matrix is not positive definite.
        """
        band = self._band.copy()
        band[..., 0] += more
        rows = band.reshape(more.size, -1).T
        try:
            found = solveh_banded(
                rows, -(self.slope + pull).ravel(), lower=True, overwrite_ab=True,
                check_finite=False,
            )  # fmt: skip
        except LinAlgError as failure:
            raise SolverError(
                f"retarget: the motion's least squares failed: {failure}"
            ) from failure
        return np.asarray(found.reshape(pull.shape))


def padded(frames: NDArray[np.intp], J: Array, off: Array, count: int) -> tuple[Array, Array]:
    """Return rows (k, nv) and errors (k,) of increasing frames by frame, filled up with zeros."""
    place = np.arange(len(frames)) - np.searchsorted(frames, frames)  # in its frame
    shape = count, int(place.max()) + 1
    rows, errors = np.zeros((*shape, J.shape[1])), np.zeros(shape)
    rows[frames, place], errors[frames, place] = J, off
    return rows, errors
