"""QPs with rows that give way, without their slacks as unknowns: in the core alone.

A row that gives way at the cost of 1/2 w s^2 has the slack s = z / w, by its multiplier z. What is
solved so is a fraction of the QP with slacks (of a G1 from wild states 50 unknowns in place of 100
to 300), and the same QP: the residuals are its own.
"""

from __future__ import annotations

import ctypes
from time import perf_counter

import numpy as np

from wbc.native import address, core
from wbc.qp.native_daqp import QpMemory, scratch_sizes, solution_of
from wbc.qp.problem import QP
from wbc.qp.solution import Solution
from wbc.validate import Array

NAME = "active_set"


def solve_giving(qp: QP, weights: Array, eps: float, max_iterations: int) -> Solution | None:
    """Return the solution, slacks of rows that may give way behind the unknowns.

    None: there is no core, or no answer of residuals below ``eps``.

    Parameters
    ----------
    qp:
        Without slacks.
    weights:
        (mi,) of the slacks' squares, infinite for rows that may not give way.
    """
    native, start = core(), perf_counter()
    known = None if native is None else QpMemory.of(qp, eps)
    if native is None or known is None:
        return None
    n, k, m = known.sizes
    left, most = n - k, n + m
    size, integers = scratch_sizes(n, k, m)
    size += 2 * left + 10 * most + 2 * left * left + most * left + most * most // 2
    memory, order = np.empty(size), np.empty(integers + 3 * most, dtype=np.int64)
    give = np.ascontiguousarray(1.0 / weights)
    places = address(give), max_iterations, address(memory), address(order)
    if native.wbc_solve_giving(ctypes.addressof(known.struct), *places) != 0:
        return None
    x, y, z, z_box = known.parts()
    slack = (give * z)[np.isfinite(weights)]
    parts = np.concatenate((x, slack)), y, z, np.concatenate((z_box, np.zeros(slack.size)))
    return solution_of(parts, known.out[-4:], perf_counter() - start, NAME)
