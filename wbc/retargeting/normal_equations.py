"""Normal equations in which only neighbouring frames are coupled: one band of a matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import as_strided
from numpy.typing import NDArray
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
        (n, 4, nv): what is added to the diagonals of the blocks.
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
        # Transposed they lie in memory as NumPy's arrays do, and are added to in half the time.
        self._turned = np.swapaxes(self.blocks, 2, 3)
        self.diagonal = np.zeros((count, SPAN + 1, nv))
        self.slope = np.zeros((count, nv))

    def add(self, A: Array, off: Array) -> None:
        """Add A_k d_k, rows (n, r, nv), errors (n, r)."""
        At = np.swapaxes(A, 1, 2)
        self.slope += (At @ off[..., None])[..., 0]
        self._turned[:, 0] += At @ A

    def add_first_differences(self, A: Array, off: Array, after: Array | None = None) -> None:
        """Add B_k d_k+1 - A_k d_k, rows (n - 1, r, nv), errors (n - 1, r); B is A, or ``after``."""
        At = np.swapaxes(A, 1, 2)
        Bt = At if after is None else np.swapaxes(after, 1, 2)
        square, both = At @ A, At @ A if after is None else Bt @ A
        self.slope[:-1] -= (At @ off[..., None])[..., 0]
        self.slope[1:] += (Bt @ off[..., None])[..., 0]
        self._turned[:-1, 0] += square
        self._turned[:-1, 1] -= both
        self._turned[1:, 0] += square if after is None else Bt @ after

    def add_second_differences(self, A: Array, off: Array) -> None:
        """Add A_k+1 (d_k+2 - d_k+1) - A_k (d_k+1 - d_k), rows (m + 1, r, nv), errors (m, r)."""
        count = len(off)
        At = np.swapaxes(A, 1, 2)
        own, last = At @ A, At[1:] @ A[:-1]
        here, there = own[:-1], own[1:]
        turned, both = self._turned, here + last
        turned[:count, 0] += here
        turned[:count, 1] -= both
        turned[:count, 2] += last
        turned[1 : count + 1, 0] += both + np.swapaxes(last, 1, 2) + there
        turned[1 : count + 1, 1] -= last + there
        turned[2 : count + 2, 0] += there
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
        """Put diagonals in and take out what is behind the band: once, before it is solved."""
        np.einsum("kmii->kmi", self.blocks)[...] += self.diagonal
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


def padded(frames: NDArray[np.intp], J: Array, off: Array, count: int) -> tuple[Array, Array]:
    """Return rows (k, nv) and errors (k,) of increasing frames by frame, filled up with zeros."""
    place = np.arange(len(frames)) - np.searchsorted(frames, frames)  # in its frame
    shape = count, int(place.max()) + 1
    rows, errors = np.zeros((*shape, J.shape[1])), np.zeros(shape)
    rows[frames, place], errors[frames, place] = J, off
    return rows, errors
