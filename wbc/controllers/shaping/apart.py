"""Searches that keep bodies apart, with few of all pairs in the program at a time.

A humanoid has some 600 pairs of bodies that could meet, of which a dozen are near each other at any
answer. So a search begins without pairs; those that its answer brings too near get planes between
them (:mod:`.planes`), and it goes on from there, until no pair is too near. All this is one search,
in one process: its answer depends on its start alone.

The first answer may have an arm through the chest, whence no way leads out that IPOPT can see. So
the search goes on from a free posture: the first on the straight way from its start, or else from
the first answer, to standing. Measured on a G1 made as small as it gets: so 24 of 24 searches come
to a posture that is free, about two thirds if they go on from the first answer itself. One such
search takes half a second where one without pairs takes 25 ms; with hulls of a hundred corners for
bodies, ten seconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter

import casadi as ca
import numpy as np

from wbc.controllers.shaping.bodies import Bodies
from wbc.controllers.shaping.joined import Pieces, joined
from wbc.controllers.shaping.nearness import USED, Corners, Nearness, slot_of
from wbc.controllers.shaping.planes import plane_rows
from wbc.controllers.shaping.program import (
    Local,
    Program,
    Searcher,
    Start,
    ended,
    solver_options,
)
from wbc.controllers.shaping.unknowns import Chart
from wbc.robot.postures import STANDING
from wbc.validate import Array

ROUNDS = 25
STEPS = 21  # on the way back to standing
LATE = "Maximum_WallTime_Exceeded"  # IPOPT's own word


@dataclass(frozen=True, eq=False)
class Watched:
    """The bodies that a program is to keep apart; can be sent to another process.

    Attributes
    ----------
    placements:
        (x, p) -> T (12 m, 1), of the bodies' joints as seen from the base.
    chart:
        From x and p to configurations.
    """

    bodies: Bodies
    placements: ca.Function
    chart: Chart


class ApartSearcher:
    """Searches for postures at which bodies are apart."""

    def __init__(self, program: Program, watched: Watched) -> None:
        self._program, self._watched = program, watched
        chart = watched.chart
        self._first = Searcher(program)
        self._near = Nearness(watched.bodies, chart)
        self._pieces: Pieces | None = None
        limits = chart.robot.limits
        joints = limits.joint_positions(chart.robot.postures[STANDING])
        self._joints = [k for k, unknown in enumerate(chart.kept) if unknown < joints.size]
        home = joints[[chart.kept[k] for k in self._joints]]
        self._home = np.clip(home, program.lower[self._joints], program.upper[self._joints])

    def search(self, start: Start) -> Local:
        """Return where the search ends, after at most some rounds and, if limited, some time."""
        began = perf_counter()
        longest = float(self._program.options.get("max_wall_time", np.inf))
        local = self._first.search(start)
        iterations, apart = local.iterations, False
        used: dict[int, Corners] = {}
        for _ in range(ROUNDS):
            if not np.isfinite(local.x).all() or not self._near.grow(used, local.x, start.p):
                break
            left = longest - (perf_counter() - began)
            if left <= 0.0:
                local = local._replace(status=LATE, optimal=False)  # not of the whole problem
                break
            x = local.x
            if not apart:
                x = self._free(start, x)
            elif not local.optimal:
                x, _ = self._retreat(x, start.p)
            apart = True
            local = self._round(used, start._replace(x=x), left)
            iterations += local.iterations
        return local._replace(iterations=iterations)

    def _free(self, start: Start, first: Array) -> Array:
        """Return where to go on from when the first answer brings bodies too near.

        From near the start, if anything but standing itself is free there: starts differ, and may
        have been chosen well. Else from near the first answer.
        """
        x, share = self._retreat(start.x, start.p)
        return x if share < 1.0 else self._retreat(first, start.p)[0]

    def _retreat(self, x: Array, p: Array) -> tuple[Array, float]:
        """Return the first x on the way to standing at which no pair is near, or the best there.

        And the share of the way that it took.
        """
        found = []
        for share in np.linspace(0.0, 1.0, STEPS):
            moved = x.copy()
            moved[self._joints] += share * (self._home - x[self._joints])
            excess = self._near.least(moved, p)
            if excess >= -USED:
                return moved, float(share)
            found.append((excess, moved))
        return max(found, key=lambda one: one[0])[1], 1.0

    def _round(self, used: Mapping[int, Corners], start: Start, left: float) -> Local:
        """Return where IPOPT ends with planes between the pairs in use, in what time is left."""
        if self._pieces is None:
            self._pieces = Pieces.of(self._program, self._watched.placements)
        program, bodies = self._program, self._watched.bodies
        pairs = sorted(used)
        blocks = {joint: k for k, joint in enumerate(bodies.joints)}
        slots = [slot_of(bodies, blocks, pair, used[pair]) for pair in pairs]
        planes = plane_rows(slots, self._watched.placements.size1_out(0))
        expressions, derivatives = joined(self._pieces, planes)
        limited = {} if np.isinf(left) else {"max_wall_time": left}
        options = solver_options({**program.options, **limited}) | derivatives
        solver = ca.nlpsol("apart", "ipopt", expressions, options)
        y = self._near.planes(pairs, start.x, start.p)
        free = np.full(y.size, np.inf)
        found = solver(
            x0=np.concatenate((start.x, y)),
            p=start.p,
            lbx=np.concatenate((program.lower, -free)),
            ubx=np.concatenate((program.upper, free)),
            lbg=np.concatenate((program.g_lower, planes.lower)),
            ubg=np.concatenate((program.g_upper, planes.upper)),
        )
        return ended(solver, found, start.x.size)
