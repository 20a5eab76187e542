"""QPs as DAQP takes them, in memory that is kept: the shortest way from Python to its solver.

``daqp.solve`` takes a third of its time for what is around the solver. Its C function is called
directly where :mod:`wbc.qp.daqp_direct` finds it, and through Python where it does not.
"""

from __future__ import annotations

import ctypes
import threading
from typing import Any, NamedTuple

import daqp
import numpy as np

from wbc.native import address
from wbc.qp.daqp_direct import Problem, Result, direct_daqp
from wbc.qp.kkt import Stacked
from wbc.qp.problem import QP
from wbc.validate import Array

EQUALITY = 5  # DAQP's code for a row that always holds
MOST = 64  # sets of memory that a thread keeps: margins change the number of rows

_QUADPROG = ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 3)


class DaqpAnswer(NamedTuple):
    """What DAQP says: x (n,), multipliers (n + mi + me,) of bounds and rows, its exit flag."""

    x: Array
    multipliers: Array
    iterations: int
    flag: int


class DaqpMemory:
    """Memory for QPs of some size, and DAQP's settings.

    Attributes
    ----------
    stacked:
        The QP that was loaded last.
    """

    def __init__(self, n: int, mi: int, me: int, eps: float, max_iterations: int) -> None:
        m = n + mi + me
        self.stacked = Stacked(
            np.zeros((n, n)),
            np.zeros(n),
            np.zeros((mi + me, n)),
            np.zeros(m),
            np.zeros(m),
            n + mi,
        )
        self._sense = np.zeros(m, dtype=np.intc)
        self._sense[n + mi :] = EQUALITY
        self._out = np.zeros(n + m)
        self._settings: dict[str, Any] = {"primal_tol": 0.1 * eps, "iter_limit": max_iterations}
        direct = direct_daqp()
        self._call = None
        if direct.address:
            P, g, rows, lower, upper, _ = self.stacked
            places = [address(one) for one in (P, g, rows, upper, lower, self._sense)]
            out = address(self._out)
            self._result = Result(out, out + n * self._out.itemsize)
            given = Problem(n, m, n, *places, None, 0, 0)
            self._given = given, direct.settings(eps, max_iterations)
            arguments = (self._result, *self._given)
            self._addresses = tuple(ctypes.addressof(one) for one in arguments)
            self._call = _QUADPROG(direct.address)

    def solve(self, qp: QP) -> DaqpAnswer:
        """Return DAQP's answer for a QP of this size, which is stacked meanwhile."""
        P, g, rows, lower, upper, _ = self.stacked
        P[:] = qp.P
        g[:] = qp.g
        np.concatenate((qp.C, qp.A), out=rows)
        np.concatenate((qp.lower, qp.l, qp.b), out=lower)
        np.concatenate((qp.upper, qp.u, qp.b), out=upper)
        if self._call is None:
            x, _, flag, info = daqp.solve(P, g, rows, upper, lower, self._sense, **self._settings)
            return DaqpAnswer(x, info["lam"], info["iterations"], flag)
        self._call(*self._addresses)
        out, result = self._out.copy(), self._result
        return DaqpAnswer(out[: g.size], out[g.size :], result.iterations, result.flag)


class _PerThread(threading.local):
    """The memory of each thread, by sizes and settings."""

    def __init__(self) -> None:
        self.kept: dict[tuple[int, int, int, float, int], DaqpMemory] = {}


_PER_THREAD = _PerThread()


def daqp_memory(qp: QP, eps: float, max_iterations: int) -> DaqpMemory:
    """Return this thread's memory for QPs of the size of ``qp``; what it holds is overwritten."""
    kept = _PER_THREAD.kept
    key = (qp.g.size, qp.u.size, qp.b.size, eps, max_iterations)
    memory = kept.get(key)
    if memory is None:
        if len(kept) >= MOST:
            kept.clear()
        memory = kept[key] = DaqpMemory(*key)
    return memory
