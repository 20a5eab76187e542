"""One QP handed to the core's active-set method, and what it says, unchecked."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from wbc.native import doubles, ffi, integers, lib
from wbc.qp.problem import QP, check_qp
from wbc.qp.solution import KktResiduals
from wbc.validate import Array

DONE, INFEASIBLE = lib.DONE, lib.INFEASIBLE
_GIVEN = ("P", "A", "C", "g", "lower", "upper", "b", "l", "u")


class CoreAnswer(NamedTuple):
    """What the core says of a QP.

    Attributes
    ----------
    said:
        0: x and the multipliers are optimal to the accuracy asked for.
    x, y, z, z_box:
        (n,), (me,), (mi,), (n,); of a QP without a point a certificate in place of multipliers.
    residuals:
        Of the answer, if it has one.
    iterations:
        Negative where there is no answer at all.
    """

    said: int
    x: Array
    y: Array
    z: Array
    z_box: Array
    residuals: KktResiduals
    iterations: int


def solve_in_core(qp: QP, eps: float, most: int, give: Array | None = None) -> CoreAnswer:
    """Return what the core says of a QP in at most ``most`` iterations.

    Parameters
    ----------
    give:
        (mi,) inverse weights of the rows' slacks, 0 for rows that may not give way; None: none may.

    Raises
    ------
    InvalidInputError
        See :func:`wbc.qp.problem.check_qp`.
    """
    n, k, m = sizes = qp.g.size, qp.b.size, qp.u.size
    arrays = (qp.P, qp.A, qp.C, qp.g, qp.lower, qp.upper, qp.b, qp.l, qp.u)
    shapes = ((n, n), (k, n), (m, n), (n,), (n,), (n,), (k,), (m,), (m,))
    if tuple([array.shape for array in arrays]) != shapes:
        check_qp(qp)
    given = [np.ascontiguousarray(array, dtype=np.float64) for array in arrays]
    working, places = _sizes(*sizes)
    scratch, order = np.empty(working), np.empty(places, dtype=np.int64)
    out = np.empty(2 * n + k + m + 4)
    at = doubles(out)
    struct = ffi.new("wbc_qp *", {"n": n, "k": k, "m": m, "eps": eps})
    for name, array in zip(_GIVEN, given, strict=True):
        setattr(struct, name, doubles(array))
    struct.x, struct.y, struct.z, struct.z_box = at, at + n, at + n + k, at + n + k + m
    struct.found = at + out.size - 4
    soft = ffi.NULL if give is None else doubles(give)
    said = lib.wbc_solve_qp(struct, soft, most, doubles(scratch), integers(order))
    if said == lib.NOT_FINITE:
        check_qp(qp)
    *residuals, iterations = out[-4:].tolist()
    y, z, z_box = n, n + k, n + k + m  # where they begin
    parts = out[:y], out[y:z], out[z:z_box], out[z_box:-4]
    return CoreAnswer(said, *parts, KktResiduals(*residuals), int(iterations))


@lru_cache(maxsize=256)
def _sizes(n: int, k: int, m: int) -> tuple[int, int]:
    """Return how many numbers, and how many whole ones, the core works with."""
    wanted = np.empty(2, dtype=np.int64)
    lib.wbc_sizes(n, k, m, integers(wanted))
    return int(wanted[0]), int(wanted[1])
