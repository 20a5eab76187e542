"""DAQP behind an elimination of the equalities, and the KKT residuals, in one call of the core.

What :mod:`wbc.qp.elimination` and :mod:`wbc.qp.kkt` do in Python, around DAQP's own function. It
answers with a solution whose residuals are small, or leaves the QP to the path in Python.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable, Sequence
from functools import lru_cache
from time import perf_counter
from typing import NamedTuple

import numpy as np

from wbc.native import VARIABLE, Core, address, core
from wbc.qp.daqp_direct import direct_daqp
from wbc.qp.problem import QP
from wbc.qp.solution import KktResiduals, RawSolution, Solution, Status
from wbc.qp.work import ACTIVE_SET, Work
from wbc.validate import Array

UNSOLVED = -1  # of enum handed_over in source/core.h
# In place of iterations: nobody was asked, since equality rows depend on each other; else DAQP's
# exit flag, or its "infeasible" where such rows contradict each other.
UNASKED = -100.0
_FIELDS = ("P", "A", "C", "g", "lower", "upper", "b", "l", "u")


class _Qp(ctypes.Structure):
    """``wbc_qp`` of wbc/native/source/core.h, as far as it is of use here, with a reserve."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("n", "k", "m")),
        ("eps", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in (*_FIELDS, "x", "y", "z", "z_box", "found")),
        ("reserve", ctypes.c_void_p * 6),
    ]


class QpMemory(NamedTuple):
    """A QP as the core takes it, and where it writes the answer.

    Attributes
    ----------
    sizes:
        How many unknowns, equality and inequality rows.
    given:
        What the structure points at.
    """

    sizes: tuple[int, int, int]
    given: Sequence[Array]
    struct: _Qp
    out: Array

    @classmethod
    def of(cls, qp: QP, eps: float) -> QpMemory | None:
        """Return it; None if this is no QP, or too few unknowns for its equalities."""
        n, k, m = sizes = qp.g.size, qp.b.size, qp.u.size
        arrays = (qp.P, qp.A, qp.C, qp.g, qp.lower, qp.upper, qp.b, qp.l, qp.u)
        shapes = ((n, n), (k, n), (m, n), (n,), (n,), (n,), (k,), (m,), (m,))
        labels = qp.labels
        if tuple([array.shape for array in arrays]) != shapes or k >= n:
            return None
        if (len(labels.variables), len(labels.equality), len(labels.inequality)) != sizes:
            return None
        given = [np.ascontiguousarray(array, dtype=np.float64) for array in arrays]
        out = np.empty(2 * n + k + m + 4)
        at = address(out)
        places = (at, at + 8 * n, at + 8 * (n + k), at + 8 * (n + k + m), at + 8 * (out.size - 4))
        return cls(sizes, given, _Qp(*sizes, eps, *map(address, given), *places), out)

    def parts(self) -> tuple[Array, Array, Array, Array]:
        """Return x, y, z and z of the box as the core wrote them."""
        n, k, m = self.sizes
        out = self.out
        return out[:n], out[n : n + k], out[n + k : n + k + m], out[n + k + m : -4]


class NativeDaqp:
    """The core's solver with some settings.

    Parameters
    ----------
    eps:
        What the residuals of an answer must be below.
    """

    def __init__(self, native: Core, eps: float, max_iterations: int) -> None:
        self._eps, self._max_iterations = eps, max_iterations
        self._call = native.wbc_solve_qp
        self._settings = direct_daqp().settings(eps, max_iterations)
        self._last = direct_daqp().address, ctypes.addressof(self._settings)

    def __reduce__(self) -> tuple[object, ...]:  # elsewhere there may be another core, or none
        return native_daqp, (self._eps, self._max_iterations)

    def solve(
        self,
        qp: QP,
        name: str,
        quick: bool = False,
        work: Work | None = None,
        most: int | None = None,
    ) -> Solution | None:
        """Return the solution; None if this is no QP, or no answer of small residuals was found.

        ``quick``: where DAQP was asked, what it does not solve has failed, with no proof of it. Of
        1767 QPs of ticks from wild states that it called infeasible it solved none either with the
        equalities left in, which takes as long again; of 18 others four. ``work`` is that of the
        tick, which affords ``most`` iterations.
        """
        start = perf_counter()
        known = QpMemory.of(qp, self._eps)
        if known is None:
            return None
        size, integers = scratch_sizes(*known.sizes)
        memory, order = np.empty(size), np.empty(integers, dtype=np.int64)
        scratch, out, last = (address(memory), address(order)), known.out, self._last
        out[-4:] = 0.0  # what is no QP takes no iterations
        if most is not None and most < self._max_iterations:  # others may use the core's own
            settings = direct_daqp().settings(self._eps, most)
            last = last[0], ctypes.addressof(settings)
        said = self._call(ctypes.addressof(known.struct), *scratch, *last)
        if work is not None:
            work.spent += ACTIVE_SET.units(qp, iterations_of(out[-4:]))
        if quick and said == UNSOLVED and known.out[-1] != UNASKED:
            return refused(qp, perf_counter() - start, name)
        if said != 0:
            return None
        return solution_of(known.parts(), known.out[-4:], perf_counter() - start, name)


def iterations_of(found: Array) -> int:
    """Return DAQP's iterations from what the core found (4,): the first number where it failed."""
    return int(found[3] if found[3] >= 0.0 else found[0])


def refused(qp: QP, spent: float, name: str) -> Solution:
    """Return what is said in a hurry of a QP that DAQP did not solve."""
    raw = RawSolution.none(qp, Status.FAILED, "no answer in a hurry, and nobody else was asked")
    none = KktResiduals(np.inf, np.inf, np.inf)
    return Solution(*raw[:4], raw.claim, none, 0, spent, name, message=raw.message)


def native_daqp(eps: float, max_iterations: int) -> NativeDaqp | None:
    """Return the core's solver; None where there is no core, or DAQP cannot be called by it."""
    return _native_daqp(eps, max_iterations, os.environ.get(VARIABLE))


@lru_cache(maxsize=64)
def _native_daqp(eps: float, max_iterations: int, mode: str | None) -> NativeDaqp | None:
    native = core()
    if native is None or not direct_daqp().address:
        return None
    return NativeDaqp(native, eps, max_iterations)


def scratch_sizes(n: int, k: int, m: int) -> tuple[int, int]:
    """Return how many numbers and integers the core works in: as ``place`` of source/reduce.c."""
    left = n - k
    numbers = k * (n + k + 5) + 2 * k * (left + 3) + left * left + 3 * n + 3 * (n + m)
    numbers += (m + k) * left + left * (left + 4)
    return numbers, 2 * n + m


def solution_of(
    parts: Iterable[Array], found: Array, spent: float, name: str, attempts: int = 1
) -> Solution:
    """Return the core's accurate answer as a solution.

    Parameters
    ----------
    parts:
        x, y, z and z of the box.
    found:
        (4,) primal, dual and complementarity residual, and iterations.
    """
    *residuals, iterations = found.tolist()
    x, y, z, z_box = parts
    known = KktResiduals(*residuals)
    solved = Status.SOLVED
    return Solution(x, y, z, z_box, solved, known, int(iterations), spent, name, None, attempts)
