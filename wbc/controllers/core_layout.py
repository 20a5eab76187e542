"""Where the QP of a level, its answer and what else is known of a tick lie in the core's memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from wbc.validate import Array


class LevelViews(NamedTuple):
    """The QP of a level, its answer, and what else is known of a tick: views on its memory."""

    P: Array
    A: Array
    C: Array
    g: Array
    lower: Array
    upper: Array
    b: Array
    l: Array  # noqa: E741
    u: Array
    x: Array
    y: Array
    z: Array
    z_box: Array
    found: Array  # (5,) primal, dual and complementarity residual, iterations, levels solved
    # Base forces and torques by the unknowns; empty at the velocity level.
    D: Array  # (nv, n)
    offset: Array  # (nv,)
    errors: Array  # of all costs, one behind the other
    heaviest: Array  # (1,) the largest square of a weighted row of the first level
    exact: Array  # v+ (nv,) that meets the base's dynamics to rounding
    torque: Array  # (nv - 6,) at that
    clearance: Array  # of the margin's rows, the last of C [m]
    chosen: Array  # the numbers of their pairs


class Layout:
    """Where the arrays of a level lie in a tick's memory, as the core says.

    ``sizes``: n, k, m.
    ``out``, ``below``: how many numbers there are in all.
    """

    def __init__(self, at: Sequence[int], level: int, nv: int, torque: bool, costs: int) -> None:
        n, k, m = self.sizes = tuple(at[:3])
        self.out, self.below = at[25], at[26]
        D, pairs = nv * torque, self.out - at[24]
        counts = [n * n, k * n, m * n, n, n, n, k, m, m, n, k, m, n, 5]
        counts += [D * n, D, costs, 1, nv * torque, (nv - 6) * torque, pairs, pairs]
        self.places = [slice(b, b + c) for b, c in zip(at[3:25], counts, strict=True)]
        self._below = [bool(level) and i < 14 and i != 2 for i in range(22)]
        x, exact = self.places[9], self.places[18]
        self.velocity = exact if torque else slice(x.start, x.start + nv)
        self.contact_forces = slice(x.start + nv, x.start + n)
        self.torque, self.found = self.places[19], self.places[13]

    def read(self, out: Array, below: Array) -> LevelViews:
        """Return views on what the core wrote."""
        n = self.sizes[0]
        memory = zip(self.places, self._below, strict=True)
        parts = [(below if there else out)[place] for place, there in memory]
        for i in (0, 1, 2, 14):
            parts[i] = parts[i].reshape(-1, n)
        return LevelViews(*parts)
