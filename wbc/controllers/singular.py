"""Singularity-robust tasks: a singular task's rate is reduced in its singular directions only.

With straight knees, a straight arm, or nearly dependent tasks, a small rate of the error takes huge
joint rates. Tasks that have opted in (``singular_threshold``) are treated together, in the null
space of the held rows. Let X (nv, k) be the motions that bring about one unit of each row, the
smallest such motions by the joints' weights. With W the rows' weights, c the weighted rates that
the tasks want beyond those that the held rows cause, and E = W * singular_threshold,

    A A' = W (X' X)^-1 W,    L = positive part of (E^2 - A A'),    c' = A A' (A A' + L)^-1 c

replaces c. For equal joint weights A is W J N, with N (nv, free) an orthonormal basis of the null
space of the held rows. The weights only choose the motion; whether it is singular is decided by its
joint rates, unweighted in rad/s.

For one task this is least squares damped by numerical filtering
(Maciejewski and Klein 1988) with the variable damping of Nakamura and Hanafusa (1986) and
Chiaverini (1997): in a direction of singular value s the joint rate is the wanted rate times
s / max(s, singular_threshold)^2. For any number of tasks:

- Where A A' - E^2 is positive definite, c' = c; where a singular value passes the threshold, or two
cross, nothing jumps: c' is a continuous function of A, unlike singular vectors.
- Joint rates |v| no greater than |wanted rates / singular_threshold| achieve c'.
- Between tasks that contradict each other outright the weights still decide.

The wanted rate is filtered rather than the motion damped: directions in which a task has no effect
are free for other tasks, such as a posture that leads away from the singularity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from wbc.laws import Rows
from wbc.validate import Array

# Least weight of a row relative to the heaviest; lighter rows are raised to it, for accuracy.
LIGHTEST = 1e-4
# Diagonal entries of R below this fraction of the largest belong to dependent held rows.
RANK_TOLERANCE = 1e-9
# Relative accuracy of Gram matrices, as a fraction of their diagonals.
ROUNDING = 1e-13


class Singularity(NamedTuple):
    """Rank and conditioning of one task in the null space that is left to it.

    ``rank``: rank of its rows that have weight: the number of singular values at or above
    ``singular_threshold``. They are those of the Jacobian in the null space, and for joints of
    different weights those of A above without W.
    ``least``: least singular value [the error's unit/s per rad/s].
    ``condition``: largest over least singular value; infinite if the least is 0.
    ``rate_reduction``: (k,) wanted minus reduced rate of the error. None if neither this task is
    singular nor all tasks of its level together that have opted in.
    """

    rank: int
    least: float
    condition: float
    rate_reduction: Array | None


class Grams(NamedTuple):
    """Gram matrices of the smallest motions Y (nv, k) along each row, in the joints' metric."""

    rate: Array  # (k, k) J Y, the rates of the rows
    speed: Array | None  # (k, k) Y' Y; None if all joints weigh 1, as it is then the same

    def of(self, rows: slice) -> Grams:
        """Return the Gram matrices of some rows."""
        return Grams(self.rate[rows, rows], None if self.speed is None else self.speed[rows, rows])


class NullSpace(NamedTuple):
    """The null space of the held rows, in the joints' metric (velocities times ``root``)."""

    row_space: Array  # (nv, rank) orthonormal basis of the motions that the held rows fix
    particular: Array  # (nv,) the smallest motion that meets the held rows
    root: Array  # (nv,) square roots of the joints' weights


def reduce_singular(
    rows: Sequence[Rows], held: Sequence[Rows], root: Array
) -> tuple[list[Rows], dict[int, Singularity]]:
    """Return rows with reduced rates of the singular ones, and singularities by row index.

    ``rows``: costs of one level; those whose ``singular_threshold`` is 0 stay as they are.
    ``held``: rows that are met whatever the costs: contacts, and the achieved rates of more
    important tasks.
    ``root``: (nv,) square roots of the joints' weights.
    """
    chosen = [k for k, row in enumerate(rows) if row.singular_threshold and row.weight.any()]
    if not chosen:
        return list(rows), {}
    stack = [_weighty(rows[k]) for k in chosen]
    free = _null_space(held, root)
    grams = _grams(np.concatenate([row.matrix for row in stack]), free)
    rate_reduction = _rate_reduction(stack, _per_speed(grams), free)
    out, found, begin = list(rows), dict[int, Singularity](), 0
    for k, row in zip(chosen, stack, strict=True):
        here = slice(begin, begin + row.weight.size)
        begin = here.stop
        lost = None
        if rate_reduction is not None:
            lost = np.zeros(rows[k].weight.size)
            lost[np.flatnonzero(rows[k].weight)] = rate_reduction[here]
            out[k] = rows[k]._replace(target=rows[k].target - lost)
        found[k] = _singularity(_per_speed(grams.of(here)), row.singular_threshold, lost)
    return out, found


def _weighty(row: Rows) -> Rows:
    """Return a task's rows without those of zero weight."""
    if row.weight.all():
        return row
    wanted = np.flatnonzero(row.weight)
    return row._replace(
        matrix=row.matrix[wanted], target=row.target[wanted], weight=row.weight[wanted]
    )


def _null_space(held: Sequence[Rows], root: Array) -> NullSpace:
    """Factorise the held rows, which may be dependent, by QR with column pivoting."""
    if not any(row.matrix.any() for row in held):
        return NullSpace(np.zeros((root.size, 0)), np.zeros(root.size), root)
    C = np.concatenate([row.matrix for row in held])
    c = np.concatenate([row.target for row in held])
    packed, pivots, tau, _, _ = lapack.dgeqp3((C / root).T)
    rank, least = tau.size, RANK_TOLERANCE * abs(packed[0, 0])
    while rank > 1 and abs(packed[rank - 1, rank - 1]) <= least:
        rank -= 1
    Q, _, _ = lapack.dorgqr(packed[:, : tau.size], tau)
    row_space = Q[:, :rank]
    along, _ = lapack.dtrtrs(packed[:rank, :rank], c[pivots[:rank] - 1], trans=1)
    return NullSpace(row_space, (row_space @ along) / root, root)


def _grams(matrix: Array, free: NullSpace) -> Grams:
    """Return the Gram matrices of J = ``matrix`` (k, nv) in the null space."""
    metric = matrix / free.root
    metric -= (metric @ free.row_space) @ free.row_space.T
    rate: Array = metric @ metric.T
    if (free.root == 1.0).all():
        return Grams(rate, None)
    metric /= free.root  # now Y'
    return Grams(rate, metric @ metric.T)


def _per_speed(grams: Grams) -> Array:
    """Return (X' X)^-1 (k, k): squared rates of the error per squared joint rates."""
    if grams.speed is None:
        return grams.rate
    speed = grams.speed.copy()  # not of full rank where tasks are singular or dependent
    speed.flat[:: len(speed) + 1] *= 1.0 + ROUNDING
    speed.flat[:: len(speed) + 1] += np.finfo(float).tiny
    _, motions, _ = lapack.dposv(speed, grams.rate)
    gram: Array = grams.rate @ motions
    return gram


def _rate_reduction(stack: Sequence[Rows], gram: Array, free: NullSpace) -> Array | None:
    """Return W^-1 (c - c') (k,), or None if no task is singular."""
    weight = np.concatenate([row.weight for row in stack])
    weight = np.maximum(weight, LIGHTEST * weight.max())
    least = np.concatenate([[row.singular_threshold] * row.weight.size for row in stack])
    floor = np.square(weight * least)
    weighted = weight[:, None] * gram * weight
    above = weighted.copy()
    above.flat[:: weight.size + 1] -= floor
    _, singular = lapack.dpotrf(above)  # cheaper than eigenvalues, on most ticks
    if not singular:
        return None
    values, vectors, _ = lapack.dsyev(-above)
    lacking = vectors * np.maximum(values, 0.0)
    lacking = lacking @ vectors.T
    wanted = [row.target - row.matrix @ free.particular for row in stack]
    _, pull, _ = lapack.dposv(weighted + lacking, weight * np.concatenate(wanted))
    rate_reduction: Array = (lacking @ pull) / weight
    return rate_reduction


def _singularity(gram: Array, threshold: float, rate_reduction: Array | None) -> Singularity:
    """Return rank and conditioning of the one task with ``gram`` (k, k)."""
    squares, _, _ = lapack.dsyev(gram, compute_v=0)
    values = [math.sqrt(max(square, 0.0)) for square in squares.tolist()]
    condition = values[-1] / values[0] if values[0] else math.inf
    rank = sum(value >= threshold for value in values)
    return Singularity(rank, values[0], condition, rate_reduction)
