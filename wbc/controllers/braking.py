"""Bounded braking: QPs of joints that cannot stop at once (see :class:`~wbc.constraints.Limits`).

**Lower gains** (:func:`scale_gains_to_brake`). Tasks demand a fraction of the error per tick, which
may be faster than joints can brake from. Hence all gains of a level are multiplied by one factor,
the largest up to 1 with which every joint can still stop at the level's optimum. With the distance
d_j to that, by Newton's method, and a demanded rate r_j d_j, it is

    s = min(1, min over joints u_j / (r_j d_j)),    u_j dt + u_j^2 / (2 SHARE a_max_j) = d_j

With one factor joints arrive together on a straight line, the slowest at its fastest, and the
balance between tasks does not change: at it d is 0, so unreachable targets are missed as before.
Feed-forward rates of moving targets are not multiplied.

**Harder braking** (:func:`relax_box`). Contacts and margins may need more than the bound: a foot
touches down while its leg moves, or the nearest points of two bodies jump. Then the QP is
infeasible, and joints must brake harder. Which ones, and by how much, follows from

    minimise  sum over joints ((v_j - v_now_j) / (a_max_j dt))^2

subject to the rows of the QP and to the box in which joints may stop at once: Gauss's principle of
least constraint, in units of each joint's acceleration limit. The box is relaxed to contain this
velocity, with a small interior, and the QP is solved again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import lapack

from wbc.constraints.limits import Box, Limits
from wbc.laws import Rows
from wbc.qp.problem import QP
from wbc.qp.solution import Solution
from wbc.robot import Snapshot
from wbc.validate import Array

# Part of ``a_max dt`` by which the box is relaxed further than needed, to leave an interior.
INTERIOR = 0.1
# Least weight of an unknown, relative to the slowest joint's; also that of the base and of slacks.
LEAST_WEIGHT = 1e-4
# Part of the acceleration that the profile uses. The rest is for curved paths, and for the end,
# where the gain takes over and first decelerates twice as hard as this profile.
ACCELERATION_SHARE = 0.7
# Weight of the equalities in Newton's step, relative to the heaviest unknown's.
EQUALITY_WEIGHT = 1e4
# Regularisation of Newton's step, relative to the same.
REGULARISATION = 1e-9
# Added to distances [rad or m], so that none is 0.
TINY = 1e-300


def scale_gains_to_brake(
    qp: QP, rows: Sequence[Rows], limits: Limits, snapshot: Snapshot, dt: float
) -> None:
    """Scale the gains of one level's QP (its g) so that all joints can brake.

    ``qp``: the QP, whose g is changed.
    ``rows``: costs of the level; those without a rate (not of the velocity law) are not scaled.
    """
    nv = snapshot.v.size
    fastest = max((row.rate for row in rows), default=0.0)
    if fastest == 0.0:
        return
    slope, distance = np.zeros(nv), np.zeros(nv)
    for row in rows:
        if row.rate == 0.0:
            continue
        own = _slope(row, row.target if row.bias is None else row.target + row.bias)
        slope += own
        if row.rate < fastest:  # a lower gain demands a smaller part of its error
            distance += (1.0 / row.rate - 1.0 / fastest) * own
    distance += slope / fastest
    newton = _solve_with_equalities(qp.P[:nv, :nv], qp.A[:, :nv], np.array((slope, distance)))
    factor = _gain_scale(newton[:, 6:], fastest, limits, snapshot, dt)
    if factor < 1.0:
        qp.g[:nv] += (1.0 - factor) * slope


def _slope(row: Rows, wanted: Array) -> Array:
    """Return what ``wanted`` (k,) adds to minus the cost's gradient (nv,) at rest."""
    slope: Array = (np.square(row.weight) * wanted) @ row.matrix
    return slope


def _solve_with_equalities(P: Array, A: Array, slopes: Array) -> Array:
    """Return x (k, n) with P x = slopes and, nearly, A x = 0; rows of A may be dependent."""
    most = float(P.diagonal().max())
    P = P.copy()
    if A.size:
        lengths = np.sqrt(np.einsum("ij,ij->i", A, A) + TINY)
        stiff = (math.sqrt(EQUALITY_WEIGHT * most) / lengths)[:, None] * A
        P += stiff.T @ stiff
    P.flat[:: len(P) + 1] += REGULARISATION * most
    _, x, _ = lapack.dposv(P.T, slopes.T, overwrite_a=True)
    solved: Array = x.T
    return solved


def _gain_scale(
    newton: Array, fastest: float, limits: Limits, snapshot: Snapshot, dt: float
) -> float:
    """Return the factor on gains, from demanded joint rates and distances (2, joints).

    With a distance d and a demanded rate r d it is the least of 2 / (r (dt + sqrt(dt^2 + 2 d /
    a))).
    """
    demanded = newton[0]
    speed, to_go = np.abs(newton)
    # Opposing tasks of low gain reduce the distance, but later.
    np.maximum(to_go, speed / fastest, out=to_go)
    to_go += TINY
    rate = speed / to_go
    q = limits.robot.limits.joint_positions(snapshot.q)
    left = np.where(demanded > 0.0, limits.upper - q, q - limits.lower)
    np.minimum(to_go, np.maximum(left, 0.0, out=left), out=to_go)  # a joint stops at its limit
    to_go /= limits.acceleration
    to_go *= 2.0 / ACCELERATION_SHARE
    to_go += dt * dt
    np.sqrt(to_go, out=to_go)
    to_go += dt
    rate *= to_go
    return float(2.0 / rate.max(initial=TINY))


def relax_box(
    qp: QP, limits: Limits, snapshot: Snapshot, dt: float, solve: Callable[[QP], Solution]
) -> QP | None:
    """Return an infeasible QP with its box relaxed as little as makes it feasible.

    Fully relaxed if that is not enough; None if it is so already. Solves one QP.
    """
    lower, upper = widest = limits.emergency_braking_box(snapshot, dt)
    nv = lower.size
    if (qp.lower[:nv] <= lower).all() and (qp.upper[:nv] >= upper).all():
        return None
    change = np.full(nv, np.inf)
    change[6:] = limits.acceleration * dt
    found = solve(least_acceleration_qp(_with_box(qp, widest), snapshot.v, change))
    if not found.solved:
        return _with_box(qp, widest)
    v, interior = found.x[:nv], INTERIOR * change
    down = np.where(v < qp.lower[:nv], np.maximum(v - interior, lower), qp.lower[:nv])
    up = np.where(v > qp.upper[:nv], np.minimum(v + interior, upper), qp.upper[:nv])
    return _with_box(qp, (down, up))


def least_acceleration_qp(qp: QP, v: Array, change: Array) -> QP:
    """Return the QP of the least change from ``v``, measured in ``change`` (nv,), (nv,)."""
    weight, now = np.full(qp.g.size, LEAST_WEIGHT), np.zeros(qp.g.size)
    weight[: v.size] = np.maximum(np.square(change.min() / change), LEAST_WEIGHT)
    now[: v.size] = v
    return qp._replace(P=np.diag(weight), g=-weight * now)


def _with_box(qp: QP, box: Box) -> QP:
    """Return ``qp`` with other bounds on the velocity; slacks, behind it, keep theirs."""
    lower, upper = box
    nv = lower.size
    return qp._replace(
        lower=np.concatenate((lower, qp.lower[nv:])), upper=np.concatenate((upper, qp.upper[nv:]))
    )
