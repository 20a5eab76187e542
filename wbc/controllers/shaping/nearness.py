"""Which pairs of bodies are too near at a posture, as the full collision model measures it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from wbc.constraints.clearance import SKIN
from wbc.controllers.shaping.bodies import Bodies
from wbc.controllers.shaping.planes import Side, Slot
from wbc.controllers.shaping.unknowns import Chart
from wbc.robot import Snapshot
from wbc.robot.names import BASE
from wbc.validate import Array

USED = 0.5 * SKIN  # m: of the distance to keep, what may be missing before a pair counts as near
FEW = 8  # corners: a body with no more has all of them in the program
DEEP = 0.005  # m: of others, those that are not further behind the foremost


class Corners(NamedTuple):
    """Which corners of the two bodies of a pair are in the program."""

    first: frozenset[int]
    second: frozenset[int]


class Nearness:
    """What is near at a posture, as the full collision model measures it."""

    def __init__(self, bodies: Bodies, chart: Chart) -> None:
        self._bodies, self._chart = bodies, chart
        self._model = bodies.model()
        self._all = np.arange(len(bodies.pairs))

    def least(self, x: Array, p: Array) -> float:
        """Return how much further apart the bodies are than they are to be, the worst pair [m]."""
        found = self._model.measure(self._at(x, p), self._all)
        return float((found.distance - self._bodies.least).min())

    def grow(self, used: dict[int, Corners], x: Array, p: Array) -> bool:
        """Add the pairs that are too near, and their foremost corners; return whether any is new.

        A pair in use that is too near all the same is so by a corner that is not in use.
        """
        here = self._at(x, p)
        found = self._model.measure(here, self._all)
        near = np.flatnonzero(found.distance - self._bodies.least < -USED)
        grown = False
        for k in near.tolist():
            before = used.get(k, Corners(frozenset(), frozenset()))
            a, b = self._bodies.pairs[k].tolist()
            n = found.normal[k]
            after = Corners(
                before.first | self._foremost(here, a, -n),
                before.second | self._foremost(here, b, n),
            )
            grown = grown or after != before
            used[k] = after
        return grown

    def planes(self, pairs: list[int], x: Array, p: Array) -> Array:
        """Return planes (4 each,) half-way between the bodies of pairs, as seen from the base."""
        here = self._at(x, p)
        found = self._model.measure(here, np.array(pairs, dtype=np.int64))
        R, origin = here.rotation(BASE), here.position(BASE)
        middle = found.point - 0.5 * found.distance[:, None] * found.normal - origin
        offsets = np.einsum("ki,ki->k", found.normal, middle)
        return np.column_stack((found.normal @ R, offsets)).ravel()

    def _at(self, x: Array, p: Array) -> Snapshot:
        return self._chart.robot.snapshot(self._chart.configuration(x, p))

    def _foremost(self, here: Snapshot, body: int, direction: Array) -> frozenset[int]:
        """Return the corners of a body that are foremost in a direction (3,) of the world."""
        corners = self._bodies.corners(body)
        if len(corners) <= FEW:
            return frozenset(range(len(corners)))
        R = here.joint_placements[0][self._bodies.bodies[body].joint]
        along = corners @ (R.T @ direction)
        return frozenset(np.flatnonzero(along >= along.max() - DEEP).tolist())


def slot_of(bodies: Bodies, blocks: Mapping[int, int], pair: int, used: Corners) -> Slot:
    """Return the slot of a pair of bodies, with the corners ``used`` of each."""
    a, b = bodies.pairs[pair].tolist()
    half = 0.5 * float(bodies.least[pair])
    sides = [
        Side(
            blocks[bodies.bodies[k].joint],
            bodies.corners(k)[sorted(corners)],
            bodies.bodies[k].shape.radius + half,
        )
        for k, corners in ((a, used.first), (b, used.second))
    ]
    return Slot(sides[0], sides[1], bodies.normal(b))
