"""Banded normal equations: only neighbouring frames are coupled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solveh_banded

from wbc.errors import SolverError
from wbc.native import doubles, lib, pointer
from wbc.validate import Array

# Rows couple a frame with the next two, and each coordinate's differences it with its own value
# three frames ahead, too.
SPAN = 3


class NormalEquations:
    """Sums of squares in displacements (n, nv) of n frames, each coupled with the next ones.

    ``gradient``: (n, nv), of half the sum of squares.
    """

    def __init__(self, count: int, nv: int) -> None:
        # LAPACK's lower band by columns: entry (i, j) of the matrix is [j, i - j].
        self._band = np.zeros((count, nv, SPAN * nv + 1))
        self.gradient = np.zeros((count, nv))

    def add(self, *parts: Array, errors: Array) -> None:
        """Add A_k d_k + B_k d_k+1 + ..., up to three parts A, B, ... (m, r, nv), errors (m, r)."""
        (count, rows, nv), span = parts[0].shape, len(parts)
        J = np.ascontiguousarray(parts[0] if span == 1 else np.stack(parts, axis=2))
        inputs = pointer(J), pointer(np.ascontiguousarray(errors))
        sums = doubles(self._band), doubles(self.gradient)
        lib.wbc_add_normal_equations(count, nv, span, rows, *inputs, self._band.shape[2], *sums)

    def add_differences(
        self, coefficients: Sequence[float], square: Array, gradient: Array, first: int = 0
    ) -> None:
        """Add differences over frames of each coordinate from ``first`` on, by itself.

        ``coefficients``: of the difference, such as (1, -2, 1); ``square``, ``gradient``: squared
        weight of each difference, and that times its error (m, k).
        """
        count, nv = len(gradient), self.gradient.shape[1]
        for i, a in enumerate(coefficients):
            self.gradient[i : count + i, first:] += a * gradient
            for j in range(i, len(coefficients)):
                self._band[i : count + i, first:, (j - i) * nv] += a * coefficients[j] * square

    def solve(self, diagonal: Array, gradient: Array) -> Array:
        """Return displacements (n, nv), with (n, nv) added to the diagonal and the gradient.

        Raises SolverError: the matrix is not positive definite.
        """
        band = self._band.copy()
        band[..., 0] += diagonal
        rows = band.reshape(diagonal.size, -1).T
        try:
            found = solveh_banded(
                rows, -(self.gradient + gradient).ravel(), lower=True, overwrite_ab=True,
                check_finite=False,
            )  # fmt: skip
        except LinAlgError as failure:
            raise SolverError(
                f"retarget: the motion's least squares failed: {failure}"
            ) from failure
        return np.asarray(found.reshape(gradient.shape))


def pad_rows(frames: NDArray[np.intp], J: Array, e: Array, count: int) -> tuple[Array, Array]:
    """Return rows (k, nv) and errors (k,) frame by frame, padded with zeros; frames are sorted."""
    place = np.arange(len(frames)) - np.searchsorted(frames, frames)  # in its frame
    shape = count, int(place.max()) + 1
    rows, errors = np.zeros((*shape, J.shape[1])), np.zeros(shape)
    rows[frames, place], errors[frames, place] = J, e
    return rows, errors
