"""DAQP's own C function, found in the extension module that Python loads, for the native core.

Its structures change with its version: they are known for the versions listed, and what is loaded
is tried on a small QP before it is used. Everywhere else DAQP is called through Python.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray

VERSIONS = frozenset({"0.11.0"})
_SETTINGS = 64  # doubles, far more than DAQP's settings have
# Places among the settings, read as integers: the limit, and whether DAQP eliminates equalities
# first (0: if it thinks best, 1: always, -1: never).
_ITERATIONS, _REDUCTION = 11, 32
_ZERO = 2  # where among the doubles is what DAQP takes for zero in a step
_TOLERANCE = 1e-6  # DAQP's default for the first of them, 1e-11 for zero, 10000 for the limit
# A finer zero. With the default DAQP calls feasible QPs infeasible, or takes all iterations, where
# curvatures are ten decades and more apart: of 1532 QPs of wild ticks, 84 of them infeasible, it
# solves 1296 (1348 if it eliminates no equalities) with the default and 1447 with this, in fewer
# iterations; 1e-13 is 9 short of that, 1e-15 no better. But singular costs need the default.
FINE = 1e-14


class Problem(ctypes.Structure):
    """``DAQPProblem``; also in wbc/native/source/solve.c."""

    _fields_ = [
        *((name, ctypes.c_int) for name in ("n", "m", "simple")),
        *((name, ctypes.c_void_p) for name in ("H", "f", "A", "upper", "lower", "sense", "breaks")),
        *((name, ctypes.c_int) for name in ("hierarchy", "kind")),
    ]


class Result(ctypes.Structure):
    """``DAQPResult``, with a reserve."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("x", "multipliers")),
        *((name, ctypes.c_double) for name in ("value", "slack")),
        *((name, ctypes.c_int) for name in ("flag", "iterations", "nodes")),
        *((name, ctypes.c_double) for name in ("solve_time", "setup_time")),
        ("reserve", ctypes.c_double * 8),
    ]


class DirectDaqp(NamedTuple):
    """DAQP's function by its address, 0 if it cannot be called, and why; ``defaults`` its settings.

    The module stays loaded, as all that Python imports.
    """

    address: int
    reason: str
    defaults: bytes = bytes(8 * _SETTINGS)

    def settings(
        self, eps: float, max_iterations: int, reduction: int = 0, fine: bool = False
    ) -> ctypes.Array[ctypes.c_double]:
        """Return settings as :class:`wbc.qp.daqp.Daqp` asks for.

        ``reduction``: -1 keeps DAQP from eliminating the equalities; ``fine``: see ``FINE``.
        """
        made = (ctypes.c_double * _SETTINGS).from_buffer_copy(self.defaults)
        made[0] = 0.1 * eps
        if fine:
            made[_ZERO] = FINE
        integers = _integers(made)
        integers[_ITERATIONS], integers[_REDUCTION] = max_iterations, reduction
        return made


@cache
def direct_daqp() -> DirectDaqp:
    """Return DAQP's function, looked for once."""
    try:
        found = version("daqp")
        if found not in VERSIONS:
            return DirectDaqp(0, f"DAQP {found} is not among {', '.join(sorted(VERSIONS))}")
        library = ctypes.PyDLL(str(daqp.__file__))
        defaults = (ctypes.c_double * _SETTINGS)()
        library.daqp_default_settings(ctypes.byref(defaults))
        limit = int(_integers(defaults)[_ITERATIONS])
        if (defaults[0], defaults[_ZERO], limit) != (_TOLERANCE, 1e-11, 10000):
            return DirectDaqp(0, "DAQP's settings are not where they were")
        address = ctypes.cast(library.daqp_quadprog, ctypes.c_void_p).value or 0
        direct = DirectDaqp(address, f"DAQP {found} is called directly", bytes(defaults))
        works = all(_works(library.daqp_quadprog, direct, reduction) for reduction in (0, 1))
        return direct if works else DirectDaqp(0, "DAQP's answer to a trial is wrong")
    except (PackageNotFoundError, OSError, AttributeError) as error:
        return DirectDaqp(0, f"DAQP's C function is not found: {error}")


def iteration_limit(settings: ctypes.Array[ctypes.c_double]) -> NDArray[np.intc]:
    """Return a view (1,) on the limit of iterations among settings."""
    return _integers(settings)[_ITERATIONS : _ITERATIONS + 1]


def _integers(settings: ctypes.Array[ctypes.c_double]) -> NDArray[np.intc]:
    """Return a view on settings, read as integers."""
    return np.ndarray(2 * _SETTINGS, dtype=np.intc, buffer=memoryview(settings))


def _works(quadprog: Callable[..., object], direct: DirectDaqp, reduction: int) -> bool:
    """Whether DAQP gives the same bits as through Python, on a QP with active rows and bounds.

    And with equalities: eliminating them leaves other bits than not doing so.
    """
    rng = np.random.default_rng(0)
    n, m = 8, 12
    square = rng.standard_normal((n, n))
    H, f, A = square.T @ square, 3.0 * rng.standard_normal(n), rng.standard_normal((m - n, n))
    upper, lower = 0.3 + rng.random(m), -0.3 - rng.random(m)
    sense = np.zeros(m, dtype=np.intc)
    sense[-2:], lower[-2:] = 5, upper[-2:]
    settings = direct.settings(1e-8, 1000, reduction)
    asked = {"primal_tol": 1e-9, "iter_limit": 1000, "eq_reduction": reduction}
    wanted, _, flag, info = daqp.solve(H, f, A, upper, lower, sense, **asked)
    x, multipliers = np.zeros(n), np.zeros(m)
    places = [array.ctypes.data for array in (H, f, A, upper, lower, sense)]
    problem = Problem(n, m, n, *places, None, 0, 0)
    result = Result(x.ctypes.data, multipliers.ctypes.data)
    quadprog(ctypes.byref(result), ctypes.byref(problem), ctypes.byref(settings))
    return bool(
        (result.flag, result.iterations) == (flag, info["iterations"])
        and np.array_equal(x, wanted)
        and np.array_equal(multipliers, info["lam"])
        and np.count_nonzero(multipliers) > 2
    )
