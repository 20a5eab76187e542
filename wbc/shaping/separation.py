"""Searches that keep bodies apart, with few of all pairs in the program at a time.

A humanoid has some 600 pairs of bodies that could meet, of which a dozen are near each other at any
answer. So a search begins without pairs; those that its answer brings too near get planes between
them (:mod:`.planes`), and it goes on from there, until no pair is too near. All this is one search,
in one process: its answer depends on its start alone.

The first answer may have an arm through the chest, whence no way leads out that IPOPT can see. So
the search goes on from a free posture: the first on the straight line from its start, or else from
the first answer, to standing. Measured on a G1 made as small as it gets: so 24 of 24 searches come
to a posture that is free, about two thirds if they go on from the first answer itself. One such
search takes half a second where one without pairs takes 25 ms; with hulls of a hundred corners for
bodies, ten seconds.
"""

from __future__ import annotations

from time import perf_counter
from typing import NamedTuple

import casadi as ca
import numpy as np

from wbc.constraints.margin import USED
from wbc.robot import Snapshot
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.shaping.nlp import (
    Ipopt,
    LocalOptimum,
    Nlp,
    Separation,
    Start,
    ipopt_options,
    local_optimum,
)
from wbc.shaping.planes import Corners, PlaneRows, plane_rows
from wbc.validate import Array

ROUNDS = 25
STEPS = 21  # on the line back to standing
LATE_ROUND = "Maximum_WallTime_Exceeded"  # IPOPT's own word
FEW_CORNERS = 8  # corners: a body with no more has all of them in the program
DEEP_OVERLAP = 0.005  # m: of others, those that are not further behind the foremost


def searcher(nlp: Nlp) -> Ipopt | SeparatedIpopt:
    """Return what searches from starts; building it takes some 0.2 s."""
    return Ipopt(nlp) if nlp.separation is None else SeparatedIpopt(nlp, nlp.separation)


class ActivePairs:
    """Which pairs of bodies are too near at a posture, by the full collision model."""

    def __init__(self, separation: Separation) -> None:
        # The pairs that have been too near in a search so far, with their foremost corners.
        self.used: dict[int, Corners] = {}
        self._bodies, self._map = separation.bodies, separation.map
        self._model = self._bodies.model()
        self._all = np.arange(len(self._bodies.pairs))

    def least(self, x: Array, p: Array) -> float:
        """Return how much further apart the bodies are than they are to be, the worst pair [m]."""
        found = self._model.measure(self._at(x, p), self._all)
        return float((found.distance - self._bodies.least).min())

    def grow(self, x: Array, p: Array) -> bool:
        """Add the pairs that are too near, and their foremost corners; return whether any is new.

        A pair in use that is too near all the same is so by a corner that is not in use.
        """
        here = self._at(x, p)
        found = self._model.measure(here, self._all)
        grown = False
        # Half of a margin's skin may be missing before a pair counts as near.
        for k in np.flatnonzero(found.distance - self._bodies.least < -USED).tolist():
            before = self.used.get(k, Corners(frozenset(), frozenset()))
            a, b = self._bodies.pairs[k].tolist()
            n = found.normal[k]
            after = Corners(
                before.first | self._most_extreme(here, a, -n),
                before.second | self._most_extreme(here, b, n),
            )
            grown = grown or after != before
            self.used[k] = after
        return grown

    def planes(self, x: Array, p: Array) -> Array:
        """Return planes (4 each,) half-way between the bodies in use, as seen from the base."""
        here = self._at(x, p)
        found = self._model.measure(here, np.array(sorted(self.used), dtype=np.int64))
        R, origin = here.rotation(BASE), here.position(BASE)
        middle = found.point - 0.5 * found.distance[:, None] * found.normal - origin
        offsets = np.einsum("ki,ki->k", found.normal, middle)
        return np.column_stack((found.normal @ R, offsets)).ravel()

    def _at(self, x: Array, p: Array) -> Snapshot:
        return self._map.robot.snapshot(self._map.configuration(x, p))

    def _most_extreme(self, here: Snapshot, body: int, direction: Array) -> frozenset[int]:
        """Return the corners of a body that are foremost in a direction (3,) of the world."""
        corners = self._bodies.corners(body)
        if len(corners) <= FEW_CORNERS:
            return frozenset(range(len(corners)))
        R = here.joint_placements[0][self._bodies.bodies[body].joint]
        along = corners @ (R.T @ direction)
        return frozenset(np.flatnonzero(along >= along.max() - DEEP_OVERLAP).tolist())


class SeparatedIpopt:
    """Searches for postures at which bodies are apart."""

    def __init__(self, nlp: Nlp, separation: Separation) -> None:
        self._nlp, self._separation = nlp, separation
        self._first = Ipopt(nlp)
        self._pairs = ActivePairs(separation)
        self._parts: NlpParts | None = None
        robot, kept = separation.map.robot, separation.map.kept
        joints = robot.limits.joint_positions(robot.postures[STANDING])
        self._joints = [k for k, unknown in enumerate(kept) if unknown < joints.size]
        home = joints[[kept[k] for k in self._joints]]
        self._home = np.clip(home, nlp.lower[self._joints], nlp.upper[self._joints])

    def search(self, start: Start) -> LocalOptimum:
        """Return where the search ends, after at most some rounds and, if limited, some time."""
        began = perf_counter()
        longest = float(self._nlp.options.get("max_wall_time", np.inf))
        local = self._first.search(start)
        iterations, separated = local.iterations, False
        self._pairs.used = {}
        for _ in range(ROUNDS):
            if not np.isfinite(local.x).all() or not self._pairs.grow(local.x, start.p):
                break
            left = longest - (perf_counter() - began)
            if left <= 0.0:
                local = local._replace(status=LATE_ROUND, optimal=False)  # not of the whole problem
                break
            x = local.x
            if not separated:
                # From near the start, if anything but standing itself is free there: starts differ,
                # and may have been chosen well. Else from near the first answer.
                near, share = self._retreat(start.x, start.p)
                x = near if share < 1.0 else self._retreat(x, start.p)[0]
            elif not local.optimal:
                x, _ = self._retreat(x, start.p)
            separated = True
            local = self._round(start._replace(x=x), left)
            iterations += local.iterations
        return local._replace(iterations=iterations)

    def _retreat(self, x: Array, p: Array) -> tuple[Array, float]:
        """Return the first x on the line to standing at which no pair is near, or the best there.

        And the share of the line that it took.
        """
        found = []
        for share in np.linspace(0.0, 1.0, STEPS):
            moved = x.copy()
            moved[self._joints] += share * (self._home - x[self._joints])
            excess = self._pairs.least(moved, p)
            if excess >= -USED:
                return moved, float(share)
            found.append((excess, moved))
        return max(found, key=lambda one: one[0])[1], 1.0

    def _round(self, start: Start, left: float) -> LocalOptimum:
        """Return where IPOPT ends with planes between the pairs in use, in what time is left."""
        nlp, separation = self._nlp, self._separation
        if self._parts is None:
            self._parts = NlpParts.of(nlp, separation.placements)
        slots = [separation.bodies.slot(*item) for item in sorted(self._pairs.used.items())]
        planes = plane_rows(slots, separation.placements.size1_out(0))
        expressions, derivatives = with_planes(self._parts, planes)
        limited = {} if np.isinf(left) else {"max_wall_time": left}
        options = ipopt_options({**nlp.options, **limited}) | derivatives
        solver = ca.nlpsol("separated", "ipopt", expressions, options)
        y = self._pairs.planes(start.x, start.p)
        free = np.full(y.size, np.inf)
        found = solver(
            x0=np.concatenate((start.x, y)),
            p=start.p,
            lbx=np.concatenate((nlp.lower, -free)),
            ubx=np.concatenate((nlp.upper, free)),
            lbg=np.concatenate((nlp.g_lower, planes.lower)),
            ubg=np.concatenate((nlp.g_upper, planes.upper)),
        )
        return local_optimum(solver, found, start.x.size)


class NlpParts(NamedTuple):
    """The parts of a program with their derivatives, as functions of x and p."""

    values: ca.Function  # -> f, g, T
    jacobians: ca.Function  # -> f, its gradient, g, its Jacobian, T, its Jacobian
    # (x, p, factor on f, multipliers of g, of T) -> upper triangle of the Hessian of their sum
    hessian: ca.Function

    @classmethod
    def of(cls, nlp: Nlp, placements: ca.Function) -> NlpParts:
        """Return the parts of a program, with T from ``placements``."""
        x = ca.SX.sym("x", nlp.lower.size)
        p = ca.SX.sym("p", nlp.functions.size1_in(1))
        f, g = nlp.functions(x, p)
        T = placements(x, p)
        factor, m = ca.SX.sym("factor"), ca.SX.sym("m", g.numel())
        by_t = ca.SX.sym("by_t", T.numel())
        total = factor * f + ca.dot(m, g) + ca.dot(by_t, T)
        first = [f, ca.gradient(f, x), g, ca.jacobian(g, x), T, ca.jacobian(T, x)]
        return cls(
            ca.Function("values", [x, p], [f, g, T]),
            ca.Function("jacobians", [x, p], first),
            ca.Function("hessian", [x, p, factor, m, by_t], [ca.triu(ca.hessian(total, x)[0])]),
        )


def with_planes(
    parts: NlpParts, planes: PlaneRows
) -> tuple[dict[str, ca.MX], dict[str, ca.Function]]:
    """Return a program with planes in CasADi's terms, unknowns x then y, and its derivatives.

    The derivatives are put together of those of the parts. Left to CasADi they take four times as
    long to evaluate; as one expression, a second to set up.
    """
    n, size = parts.values.size1_in(0), planes.value.size1_in(1)
    rows = parts.values.size1_out(1)
    z, p = ca.MX.sym("z", n + size), ca.MX.sym("p", parts.values.size1_in(1))
    x, y = z[:n], z[n:]
    f, g, T = parts.values(x, p)
    both = ca.vertcat(g, planes.value(T, y))
    _, f_x, _, g_x, _, T_x = parts.jacobians(x, p)
    by_t, by_y = planes.jacobian(T, y)
    jacobian = ca.blockcat([[g_x, ca.MX(rows, size)], [ca.mtimes(by_t, T_x), by_y]])
    factor, m = ca.MX.sym("factor"), ca.MX.sym("m", both.numel())
    gradient_t, cross, own = planes.hessian(T, y, m[rows:])
    by_x = parts.hessian(x, p, factor, m[:rows], gradient_t)
    hessian = ca.blockcat([[by_x, ca.mtimes(T_x.T, cross)], [ca.MX(size, n), own]])
    gradient = ca.vertcat(f_x, ca.MX.zeros(size))  # CasADi reads it as dense
    given = ["x", "p", "lam_f", "lam_g"]
    derivatives = {
        "grad_f": ca.Function("grad_f", [z, p], [f, gradient], given[:2], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [z, p], [both, jacobian], given[:2], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "hess_lag", [z, p, factor, m], [hessian], given, ["hess_gamma_x_x"]
        ),
    }
    return {"x": z, "p": p, "f": f, "g": both}, derivatives
