"""Normal equations in which only neighbouring frames are coupled: one band of a matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.linalg import LinAlgError, solveh_banded

from wbc.errors import SolverError
from wbc.validate import Array

SPAN = 3  # frames that are coupled


class NormalEquations:
    """Sums of squares in displacements (n, nv) of n frames, each coupled with the next three.

    Attributes
    ----------
    blocks:
        (n, 4, nv, nv): entry (k, m) is that of the displacements of frames k and k + m.
    diagonal:
        (n, 4, nv): diagonals of the blocks, a view on them.
    slope:
        (n, nv).
    """

    def __init__(self, count: int, nv: int) -> None:
        # LAPACK's lower band by columns: entry (i, j) of the matrix is number j * width + i - j, so
        # blocks are views of it. What these have above the main diagonal falls behind the band.
        width = (SPAN + 1) * nv + 1
        self._band = np.zeros((count * nv, width))
        step = self._band.itemsize
        shape = count, SPAN + 1, nv, nv
        strides = step * nv * width, step * nv, step * (width - 1), step
        # Of the last frames, blocks of frames that are not there end in the memory all the same.
        self.blocks = as_strided(self._band, shape, strides)
        self.diagonal = np.einsum("kmii->kmi", self.blocks)
        self.slope = np.zeros((count, nv))

    def add(self, parts: Sequence[Array], off: Array) -> None:
        """Add rows (m, r, nv) on as many frames in a row, whose errors are ``off`` (m, r)."""
        count = len(off)
        turned = [np.swapaxes(A, 1, 2) for A in parts]
        for i, At in enumerate(turned):
            self.slope[i : count + i] += (At @ off[..., None])[..., 0]
            for j in range(i, len(parts)):
                self.blocks[i : count + i, j - i] += At @ parts[j]

    def add_second_differences(self, A: Array, off: Array) -> None:
        """Add A_k+1 (d_k+2 - d_k+1) - A_k (d_k+1 - d_k), rows (m + 1, r, nv), errors (m, r)."""
        count = len(off)
        At = np.swapaxes(A, 1, 2)
        own, next_ = At @ A, At[:-1] @ A[1:]
        here, there = own[:-1], own[1:]
        blocks, both = self.blocks, here + next_
        blocks[:count, 0] += here
        blocks[:count, 1] -= both
        blocks[:count, 2] += next_
        blocks[1 : count + 1, 0] += both + np.swapaxes(next_, 1, 2) + there
        blocks[1 : count + 1, 1] -= next_ + there
        blocks[2 : count + 2, 0] += there
        first = (At[:-1] @ off[..., None])[..., 0]
        second = (At[1:] @ off[..., None])[..., 0]
        self.slope[:count] += first
        self.slope[1 : count + 1] -= first + second
        self.slope[2 : count + 2] += second

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
        count = len(slope)
        for i, a in enumerate(ways):
            self.slope[i : count + i, first:] += a * slope
            for j in range(i, len(ways)):
                self.diagonal[i : count + i, j - i, first:] += a * ways[j] * square

    def seal(self) -> None:
        """Take out what is behind the band, once all is added and before it is solved."""
        nv = self.slope.shape[1]
        for row in range(1, nv):
            self.blocks[:, 0, row, :row] = 0.0

    def solved(self, more: Array, pull: Array) -> Array:
        """Return displacements (n, nv), with ``more`` and ``pull`` (n, nv) on diagonal and slope.

        Raises
        ------
        SolverError
            The matrix is not positive definite.
        """
        band = self._band.copy()
        band[:, 0] += more.ravel()
        try:
            found = solveh_banded(
                band.T, -(self.slope + pull).ravel(), lower=True, overwrite_ab=True,
                check_finite=False,
            )  # fmt: skip
        except LinAlgError as failure:
            raise SolverError(
                f"retarget: the motion's least squares failed: {failure}"
            ) from failure
        return np.asarray(found.reshape(pull.shape))
