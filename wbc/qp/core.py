"""One QP handed to the core's active-set method, and what it says, unchecked."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np

from wbc.native import NativeCoreError, address, core
from wbc.qp.problem import QP, check_qp
from wbc.qp.solution import KktResiduals
from wbc.validate import Array

# enum handed_over of native/source/core.h
DONE, INFEASIBLE, NOT_FINITE = 0, -2, 3
_FIELDS = ("P", "A", "C", "g", "lower", "upper", "b", "l", "u")


class _Qp(ctypes.Structure):
    """``wbc_qp`` of wbc/native/source/core.h, as far as it is of use here, with a reserve."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("n", "k", "m")),
        ("eps", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in (*_FIELDS, "x", "y", "z", "z_box", "found")),
        ("reserve", ctypes.c_void_p * 6),
    ]


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
    native, wanted = core(), np.empty(2, dtype=np.int64)
    if native is None:
        raise NativeCoreError("the active-set method is the core's, and WBC_NATIVE=off")
    native.wbc_sizes(*sizes, address(wanted))
    numbers, integers = wanted.tolist()
    out = np.empty(2 * n + k + m + 4)
    scratch, order = np.empty(numbers), np.empty(integers, dtype=np.int64)
    at = address(out)
    places = (at, at + 8 * n, at + 8 * (n + k), at + 8 * (n + k + m), at + 8 * (out.size - 4))
    struct = _Qp(*sizes, eps, *map(address, given), *places)
    soft = None if give is None else address(give)
    work = address(scratch), address(order)
    said = native.wbc_solve_qp(ctypes.addressof(struct), soft, most, *work)
    if said == NOT_FINITE:
        check_qp(qp)
    *residuals, iterations = out[-4:].tolist()
    x, y, z, z_box, _ = np.split(out, np.cumsum([n, k, m, n]))
    return CoreAnswer(said, x, y, z, z_box, KktResiduals(*residuals), int(iterations))
