"""A QP to rounding: an interior-point method says what is active, least squares solve for it."""

import warnings

import numpy as np
import qpsolvers
from scipy.optimize import nnls
from scipy.sparse import csc_matrix

from tests.reference.state import Array

TIGHT, PULL, DEPENDENT, STEPS = 1e-9, 1e-7, 1e-9, 8
ALMOST = 1e-9  # of an optimum whose active rows are nearly dependent, where steps go round


class Unsolved(Exception):
    """There is no point that meets every row, or none was found."""


def solve(P: Array, g: Array, E: Array, x: Array, G: Array, h: Array) -> Array:
    """min 1/2 x'P x + g'x with E x as it is at x and G x <= h: Clarabel, then its active set.

    E may have dependent rows: what they leave free is spanned by N, x + N y.
    """
    _, sizes, basis = np.linalg.svd(E / np.maximum(np.linalg.norm(E, axis=1), 1e-12)[:, None])
    N = basis[np.count_nonzero(sizes > DEPENDENT) :].T
    if not N.size:
        return x
    Py, gy, Gy, hy = N.T @ P @ N, N.T @ (P @ x + g), G @ N, h - G @ x
    for size in (1.0, max(1.0, np.abs(gy).max())):  # heavy costs of recovery want small numbers
        y = optimum(Py / size, gy / size, Gy, hy)
        if y is not None:
            return x + N @ y
    raise Unsolved


def optimum(Py: Array, gy: Array, Gy: Array, hy: Array) -> Array | None:
    problem = qpsolvers.Problem(csc_matrix(Py), gy, csc_matrix(Gy), hy)
    with warnings.catch_warnings(action="ignore"):  # "almost solved" is as good: see below
        first = qpsolvers.solve_problem(problem, "clarabel", tol_gap_abs=1e-12, tol_feas=1e-12)
    if first.x is None:
        return None
    active = first.z > hy - Gy @ first.x
    for _ in range(STEPS):
        held = Gy[active]
        zero = np.zeros((len(held), len(held)))
        system = np.block([[Py, held.T], [held, zero]])
        y = np.linalg.lstsq(system, np.r_[-gy, hy[active]], rcond=1e-15)[0][: len(gy)]
        left = hy - Gy @ y
        tight = np.flatnonzero(left < TIGHT)
        z, rest = nnls(Gy[tight].T, -(Py @ y + gy)) if tight.size else (np.zeros(0), 0.0)
        if left.min() >= -TIGHT and rest <= PULL * max(1.0, np.abs(gy).max()):
            return y
        active = left < -TIGHT
        active[tight[z > 0.0]] = True
    return first.x if first.found and first.is_optimal(ALMOST) else None
