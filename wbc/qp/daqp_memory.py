"""QPs as DAQP takes them, in memory that is kept: the shortest way from Python to its solver.

``daqp.solve`` takes a third of its time for what is around the solver. Its C function is called
directly where :mod:`wbc.qp.daqp_direct` finds it, and through Python where it does not.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import daqp
import numpy as np

from wbc.native import address
from wbc.qp.daqp_direct import FINE, Problem, Result, direct_daqp, iteration_limit
from wbc.qp.kkt import PerThread, Stacked
from wbc.qp.problem import QP
from wbc.validate import Array

MOST = 1000  # iterations, until it is said how many
EQUALITY = 5  # DAQP's code for a row that always holds

_QUADPROG = ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 3)


class DaqpAnswer(NamedTuple):
    """What DAQP says: x (n,), multipliers (n + mi + me,) of bounds and rows, its exit flag."""

    x: Array
    multipliers: Array
    iterations: int
    flag: int


class DaqpMemory:
    """Memory for QPs of some size, and DAQP's settings; ``fine``: with a finer zero.

    Attributes
    ----------
    stacked:
        The QP that is loaded; its point is DAQP's last answer.
    """

    def __init__(self, n: int, mi: int, me: int, eps: float, fine: bool = False) -> None:
        m = n + mi + me
        self.stacked = stacked = Stacked(n, mi, me)
        self._sense = np.zeros(m, dtype=np.intc)
        self._sense[n + mi :] = EQUALITY
        self._settings: dict[str, Any] = {"primal_tol": 0.1 * eps}
        if fine:
            self._settings["zero_tol"] = FINE
        direct = direct_daqp()
        self._call = None
        if direct.address:
            given = stacked.P, stacked.g, stacked.rows, stacked.upper, stacked.lower, self._sense
            places = [address(one) for one in given]
            self._result = Result(address(stacked.x), address(stacked.multipliers))
            problem = Problem(n, m, n, *places, None, 0, 0)
            # Eliminating equalities makes rows of bounds. Where there are no other rows that costs
            # more than it saves: 20 for 16 us at n = 35; a QP of 59 with 63 rows takes 73 for 88.
            reduction = 0 if mi or fine else -1
            self._given = problem, direct.settings(eps, MOST, reduction, fine)
            self._limit = iteration_limit(self._given[1])
            arguments = (self._result, *self._given)
            self._addresses = tuple(ctypes.addressof(one) for one in arguments)
            self._call = _QUADPROG(direct.address)

    def solve(self, max_iterations: int) -> DaqpAnswer:
        """Return DAQP's answer for the QP that is loaded."""
        stacked = self.stacked
        if self._call is None:
            self._settings["iter_limit"] = max_iterations
            given = stacked.P, stacked.g, stacked.rows, stacked.upper, stacked.lower, self._sense
            x, _, flag, info = daqp.solve(*given, **self._settings)
            stacked.x[:], stacked.multipliers[:] = x, info["lam"]
            return DaqpAnswer(x, info["lam"], info["iterations"], flag)
        self._limit[0] = max_iterations
        self._call(*self._addresses)
        point, result = stacked.point.copy(), self._result
        count = stacked.multipliers.size
        return DaqpAnswer(point[count:], point[:count], result.iterations, result.flag)


_PER_THREAD = PerThread()


def daqp_memory(qp: QP, eps: float, fine: bool = False) -> DaqpMemory:
    """Return this thread's memory for QPs of the size of ``qp``, loaded with it."""
    key = (qp.g.size, qp.u.size, qp.b.size, eps, fine)
    memory: DaqpMemory | None = _PER_THREAD.kept.get(key)
    if memory is None:
        memory = _PER_THREAD.keep(key, DaqpMemory(*key))
    memory.stacked.load(qp)
    return memory
