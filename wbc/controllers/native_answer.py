"""What the native core writes in a tick: a QP, its answer, and what else is known of both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.validate import Array


class Answer(NamedTuple):
    """What the core wrote: views on one block of memory that nobody else holds.

    Attributes
    ----------
    D, offset:
        (nv, n), (nv,): base forces and torques by the unknowns; empty at the velocity level.
    errors:
        Of all tasks, one behind the other.
    heaviest:
        (1,) the largest square of a weighted row.
    x, y, z, z_box, found:
        The answer, and its residuals and iterations (4,).
    exact, torque:
        v+ (nv,) that meets the base's dynamics to rounding, and torques (nv - 6,) at that.
    clearance, chosen:
        Of the margin's rows, the last of C [m], and the numbers of their pairs.
    """

    P: Array
    A: Array
    C: Array
    D: Array
    offset: Array
    g: Array
    lower: Array
    upper: Array
    b: Array
    l: Array  # noqa: E741
    u: Array
    errors: Array
    heaviest: Array
    x: Array
    y: Array
    z: Array
    z_box: Array
    found: Array
    exact: Array
    torque: Array
    clearance: Array
    chosen: Array


class AnswerLayout:
    """Where the arrays of an :class:`Answer` lie, one behind the other in one block of memory.

    As in ``lay_out`` of wbc/native/source/problem.c.

    Parameters
    ----------
    sizes:
        How many unknowns, equality and inequality rows.
    nv:
        The robot's degrees of freedom.
    costs:
        Rows of tasks, whose errors are told.
    torque:
        Whether it is of the torque level.
    pairs:
        Rows of a margin between bodies.

    Attributes
    ----------
    size:
        How many numbers there are.
    velocity, contact_forces, torque, found:
        Where these are.
    """

    def __init__(
        self, sizes: tuple[int, int, int], nv: int, costs: int, torque: bool, pairs: int
    ) -> None:
        n, k, m = sizes
        D = nv if torque else 0
        each = [n * n, k * n, m * n, D * n, D, n, n, n, k, m, m, costs, 1, n, k, m, n, 4]
        each += [nv, nv - 6] if torque else [0, 0]
        each += [pairs, pairs]
        ends = np.cumsum(each).tolist()
        self._n, self._places = n, list(map(slice, [0, *ends[:-1]], ends))
        self.size = ends[-1]
        places = dict(zip(Answer._fields, self._places, strict=True))
        begin = places["x"].start
        self.velocity = places["exact"] if torque else slice(begin, begin + nv)
        self.contact_forces = slice(begin + nv, begin + n)
        self.torque, self.found = places["torque"], places["found"]

    def read(self, out: Array) -> Answer:
        """Return views on what the core wrote."""
        n = self._n
        P, A, C, D, *vectors = [out[place] for place in self._places]
        matrices = P.reshape(n, n), A.reshape(-1, n), C.reshape(-1, n), D.reshape(-1, n)
        return Answer(*matrices, *vectors)
