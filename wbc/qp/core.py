"""One QP handed to the core: what its active-set method says, and how good an answer is."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from wbc.errors import InvalidInputError
from wbc.native import doubles, ffi, integers, lib
from wbc.qp.problem import QP, Labels, check_qp
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


class FlatQP(NamedTuple):
    """A QP of a few unknowns as one list of numbers: arrays of theirs would take longer to make.

    Attributes
    ----------
    numbers:
        P, A and C by rows, g, lower, upper, b, l, u, one behind the other.
    """

    numbers: list[float]
    labels: Labels

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Unknowns, equalities, rows of C."""
        names = self.labels
        return len(names.variables), len(names.equality), len(names.inequality)

    @property
    def qp(self) -> QP:
        """It as arrays."""
        parts = np.split(np.array(self.numbers), np.cumsum(_lengths(*self.sizes))[:-1])
        by_name = dict(zip(_GIVEN, parts, strict=True))
        rows = {name: by_name[name].reshape(-1, self.sizes[0]) for name in ("P", "A", "C")}
        return QP(**by_name | rows, labels=self.labels)


def solve_flat(flat: FlatQP, eps: float, most: int) -> tuple[list[float], ...] | None:
    """Return x, z and z_box of a QP, or None where the core has no answer: see below."""
    n, k, m = sizes = flat.sizes
    working, places = _sizes(*sizes)
    end = 2 * n + k + m
    at, out = ffi.new("double[]", flat.numbers), ffi.new("double[]", end + 4 + working)
    struct = ffi.new("wbc_qp *", (n, k, m, eps, *_parts(at, _lengths(*sizes))))
    struct.x, struct.y, struct.z, struct.z_box = _parts(out, (n, k, m, n))
    struct.found = out + end
    order = ffi.new("int64_t[]", places)
    if lib.wbc_solve_qp(struct, ffi.NULL, most, out + end + 4, order) != DONE:
        return None
    x = ffi.unpack(out, end)
    return x[:n], x[n + k : n + k + m], x[n + k + m :]


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
    working, places = _sizes(*sizes)
    scratch, order = np.empty(working), np.empty(places, dtype=np.int64)
    out = np.empty(2 * n + k + m + 4)
    at = doubles(out)
    struct, _given = _struct(qp, eps)
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


def residuals_in_core(qp: QP, x: Array, y: Array, z: Array, z_box: Array) -> list[float]:
    """Return primal, dual and complementarity residual of a point and multipliers of any origin."""
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
    """Return a ``wbc_qp``, and what it points at, to be kept as long."""
    n, k, m = qp.g.size, qp.b.size, qp.u.size
    given = [np.ascontiguousarray(getattr(qp, name), dtype=np.float64) for name in _GIVEN]
    shapes = [(n, n), (k, n), (m, n), (n,), (n,), (n,), (k,), (m,), (m,)]
    if [array.shape for array in given] != shapes:
        check_qp(qp)
    struct = ffi.new("wbc_qp *", {"n": n, "k": k, "m": m, "eps": eps})
    for name, array in zip(_GIVEN, given, strict=True):
        setattr(struct, name, doubles(array))
    return struct, given


@lru_cache(maxsize=256)
def _lengths(n: int, k: int, m: int) -> tuple[int, ...]:
    """Return how many numbers each part of a QP has, in the order of a ``wbc_qp``."""
    return n * n, k * n, m * n, n, n, n, k, m, m


def _parts(at: Any, lengths: Sequence[int]) -> list[Any]:
    """Return pointers to parts of an array, one behind the other."""
    return [at + begin for begin in accumulate(lengths[:-1], initial=0)]


@lru_cache(maxsize=256)
def _sizes(n: int, k: int, m: int) -> tuple[int, int]:
    """Return how many numbers, and how many whole ones, the core works with."""
    wanted = np.empty(2, dtype=np.int64)
    lib.wbc_sizes(n, k, m, integers(wanted))
    return int(wanted[0]), int(wanted[1])
