"""One QP solved by the core's active-set method, and KKT residuals of any solution."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from wbc.errors import InvalidInputError
from wbc.native import doubles, ffi, integers, lib
from wbc.qp.problem import QP, check_qp
from wbc.qp.solution import KktResiduals
from wbc.validate import Array

DONE, INFEASIBLE = lib.DONE, lib.INFEASIBLE
_FIELDS = ("P", "A", "C", "g", "lower", "upper", "b", "l", "u")


class CoreSolution(NamedTuple):
    """The core's solution of a QP."""

    status: int  # DONE: x and the multipliers are optimal to the requested accuracy
    x: Array  # (n,)
    # Multipliers; of an infeasible QP a certificate.
    y: Array  # (me,)
    z: Array  # (mi,)
    z_box: Array  # (n,)
    residuals: KktResiduals
    iterations: int  # negative if there is no solution


def solve_in_core(qp: QP, eps: float, most: int, give: Array | None = None) -> CoreSolution:
    """Solve a QP by the core in at most ``most`` iterations.

    ``give``: (mi,) inverse weights of the rows' slacks, 0 for hard rows; None: all are hard.

    Raises InvalidInputError: see :func:`wbc.qp.problem.check_qp`.
    """
    n, k, m = sizes = qp.g.size, qp.b.size, qp.u.size
    working, places = _sizes(*sizes)
    scratch, order = np.empty(working), np.empty(places, dtype=np.int64)
    out = np.empty(2 * n + k + m + 4)
    at = doubles(out)
    struct, _given = _struct(qp, eps)
    struct.x, struct.y, struct.z, struct.z_box = at, at + n, at + n + k, at + n + k + m
    struct.found = at + out.size - 4
    soft = ffi.NULL if give is None else doubles(give)
    status = lib.wbc_solve_qp(struct, soft, most, doubles(scratch), integers(order))
    if status == lib.NOT_FINITE:
        check_qp(qp)
    *residuals, iterations = out[-4:].tolist()
    y, z, z_box = n, n + k, n + k + m  # where they begin
    parts = out[:y], out[y:z], out[z:z_box], out[z_box:-4]
    return CoreSolution(status, *parts, KktResiduals(*residuals), int(iterations))


def residuals_in_core(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> list[float]:
    """Return primal, dual and complementarity residual of any point and multipliers."""
    struct, _given = _struct(qp)
    point = [np.ascontiguousarray(part, dtype=np.float64) for part in (x, y, z, z_box)]
    sizes = qp.g.shape, qp.b.shape, qp.u.shape, qp.g.shape
    if tuple([part.shape for part in point]) != sizes:
        shapes = ", ".join(str(part.shape) for part in point)
        raise InvalidInputError(f"x, y, z, z_box of a QP: expected shapes {sizes}, got {shapes}")
    struct.x, struct.y, struct.z, struct.z_box = map(doubles, point)
    found = np.empty(3 + qp.g.size)
    struct.found = doubles(found)
    lib.wbc_residuals(struct, doubles(found) + 3)
    return found[:3].tolist()


def _struct(qp: QP, eps: float = 0.0) -> tuple[Any, object]:
    """Return a ``wbc_qp``, and the arrays that it points at, to be kept alive as long."""
    n, k, m = qp.g.size, qp.b.size, qp.u.size
    given = [np.ascontiguousarray(getattr(qp, name), dtype=np.float64) for name in _FIELDS]
    shapes = [(n, n), (k, n), (m, n), (n,), (n,), (n,), (k,), (m,), (m,)]
    if [array.shape for array in given] != shapes:
        check_qp(qp)
    struct = ffi.new("wbc_qp *", {"n": n, "k": k, "m": m, "wide": n, "eps": eps})
    for name, array in zip(_FIELDS, given, strict=True):
        setattr(struct, name, doubles(array))
    return struct, given


@lru_cache(maxsize=256)
def _sizes(n: int, k: int, m: int) -> tuple[int, int]:
    """Return how many doubles and integers of scratch the core needs."""
    wanted = np.empty(3, dtype=np.int64)
    lib.wbc_sizes(n, k, m, integers(wanted))
    return int(wanted[0]), int(wanted[1])
