"""Bounded braking: QPs of joints that cannot stop at once (see :class:`~wbc.constraints.Limits`).

**Lower gains** (:func:`scale_gains_to_brake`). Tasks ask for a fraction of the error in one tick,
which may be far more than joints can brake from. Hence all gains of a level are multiplied by one
factor, the largest up to 1 with which every joint can still stop where the level leads it. With the
distance d_j to go there, by Newton's method, and a rate of r_j d_j asked for, it is

    s = min(1, min over joints u_j / (r_j d_j)),    u_j dt + u_j^2 / (2 SHARE a_max_j) = d_j

One factor: joints arrive together, on a straight line, the slowest as fast as it can be; tasks keep
the balance between them, and where they balance d is 0: targets out of reach are missed as before.
What moving targets ask for beforehand is not multiplied.

**Harder braking** (:func:`relax_box`). Contacts and margins may ask for more than the bound: a foot
is put down while its leg moves, or the nearest points of two bodies jump. Then the QP has no
solution, and joints must brake harder. Which ones, and how much harder, is what

    minimise  sum over joints ((v_j - v_now_j) / (a_max_j dt))^2

says, subject to the rows of the QP and to the box in which joints may stop at once: Gauss's
principle of least constraint, with joints weighed by what they can do. The box is relaxed so far
that this velocity is inside, with a small interior, and the QP is solved again.
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

# Part of ``a_max dt`` by which the box is relaxed further than needed, for the solver's sake.
INTERIOR = 0.1
# Least weight of an unknown, next to the slowest joint's: of the base and of slacks, too.
LIGHT = 1e-4
# Part of the acceleration that tasks count on. The rest is for what straight lines leave out, and
# for the end, where the gain takes over: it first slows down twice as hard as this profile.
ACCELERATION_SHARE = 0.7
# Weight of the equalities where the distance to go is worked out, next to the heaviest unknown's.
HEAVY = 1e4
# What keeps rounding from making that indefinite, by the same measure.
ROUNDING = 1e-9
# Added to distances [rad or m], so that none is 0.
TINY = 1e-300


def scale_gains_to_brake(
    qp: QP, rows: Sequence[Rows], limits: Limits, snapshot: Snapshot, dt: float
) -> None:
    """Lower the gains of one level's QP by one factor, as far as joints need it: in its g.

    Parameters
    ----------
    qp:
        The QP, whose g is changed.
    rows:
        Costs of the level; those without a rate, which are not of the velocity law, stay as they
        are.
    """
    nv = snapshot.v.size
    fastest = max((row.rate for row in rows), default=0.0)
    if fastest == 0.0:
        return
    slope, later = np.zeros(nv), np.zeros(nv)
    for row in rows:
        if row.rate == 0.0:
            continue
        pulled = _slope(row, row.target if row.bias is None else row.target + row.bias)
        slope += pulled
        if row.rate < fastest:  # what is asked for in a second is a smaller part of the distance
            later += (1.0 / row.rate - 1.0 / fastest) * pulled
    later += slope / fastest
    newton = _newton(qp.P[:nv, :nv], qp.A[:, :nv], np.array((slope, later)))
    factor = _factor(newton[:, 6:], fastest, limits, snapshot, dt)
    if factor < 1.0:
        qp.g[:nv] += (1.0 - factor) * slope


def _slope(row: Rows, wanted: Array) -> Array:
    """Return what ``wanted`` (k,) adds to minus the cost's gradient (nv,) at rest."""
    slope: Array = (np.square(row.weight) * wanted) @ row.matrix
    return slope


def _newton(P: Array, A: Array, slopes: Array) -> Array:
    """Return x (k, n) with P x = slopes and A x = 0 very nearly; rows of A may be dependent."""
    most = float(P.diagonal().max())
    P = P.copy()
    if A.size:
        lengths = np.sqrt(np.einsum("ij,ij->i", A, A) + TINY)
        stiff = (math.sqrt(HEAVY * most) / lengths)[:, None] * A
        P += stiff.T @ stiff
    P.flat[:: len(P) + 1] += ROUNDING * most
    _, x, _ = lapack.dposv(P.T, slopes.T, overwrite_a=True)
    solved: Array = x.T
    return solved


def _factor(newton: Array, fastest: float, limits: Limits, snapshot: Snapshot, dt: float) -> float:
    """Return the factor on gains, from joint rates asked for and distances to go (2, joints).

    With d to go and r d asked for it is the least of 2 / (r (dt + sqrt(dt^2 + 2 d / a))).
    """
    asked = newton[0]
    speed, to_go = np.abs(newton)
    # Tasks of low gain act against it: what they take off the distance comes later.
    np.maximum(to_go, speed / fastest, out=to_go)
    to_go += TINY
    rate = speed / to_go
    q = limits.robot.limits.joint_positions(snapshot.q)
    left = np.where(asked > 0.0, limits.upper - q, q - limits.lower)
    np.minimum(to_go, np.maximum(left, 0.0, out=left), out=to_go)  # there a joint stops anyway
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
    """Return a QP that has no solution with its box relaxed as far as it must be.

    All the way, if there is no solution even so; None if it is relaxed already. Takes one more QP.
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
    weight, now = np.full(qp.g.size, LIGHT), np.zeros(qp.g.size)
    weight[: v.size] = np.maximum(np.square(change.min() / change), LIGHT)
    now[: v.size] = v
    return qp._replace(P=np.diag(weight), g=-weight * now)


def _with_box(qp: QP, box: Box) -> QP:
    """Return ``qp`` with other bounds on the velocity; slacks, behind it, keep theirs."""
    lower, upper = box
    nv = lower.size
    return qp._replace(
        lower=np.concatenate((lower, qp.lower[nv:])), upper=np.concatenate((upper, qp.upper[nv:]))
    )
