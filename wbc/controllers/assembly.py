"""From rows to the QP: costs are squared and added, contacts become equalities, limits the box."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from wbc.constraints.rows import Bounds
from wbc.laws import Rows
from wbc.qp.problem import QP, Labels
from wbc.validate import Array

# Curvatures below this fraction of the largest are raised to it: steps stay finite in flat valleys.
FLATTEST = 1e-5
# What the name of a slack variable begins with; the name of its row follows.
SLACK_OF = "slack of "
# A slack below this [m/s] is what solvers leave.
GIVEN_WAY = 1e-7


def assemble(
    costs: Sequence[Rows],
    equalities: Sequence[Rows],
    box: tuple[Array, Array],
    bounds: Bounds | None,
    labels: Labels,
    damping: float | Array,
) -> QP:
    """Return the QP of one tick.

    Parameters
    ----------
    costs:
        Rows met in the weighted least-squares sense.
    equalities:
        Rows met exactly; their weights are not used.
    box:
        Bounds (n,), (n,) on the unknown.
    bounds:
        Inequality rows, or None for none.
    labels:
        Names; those of the inequality rows are taken from ``bounds``.
    damping:
        Weight of 1/2 x^2, one or (n,); makes the optimum unique. ``costs`` add their own damping.
    """
    lower, upper = box
    n = lower.size
    stacked, wanted = _weighted(costs)
    P: Array = stacked.T @ stacked
    curved = [rows.curvature for rows in costs if rows.curvature is not None]
    if curved:
        P = convexified(P + sum(curved))
    P.flat[:: n + 1] += damping + sum(rows.damping for rows in costs)
    A = np.concatenate([rows.matrix for rows in equalities]) if equalities else np.zeros((0, n))
    b = np.concatenate([rows.target for rows in equalities]) if equalities else np.zeros(0)
    if bounds is None:
        bounds = _none(n)
    else:
        labels = Labels(labels.equality, bounds.labels, labels.variables)
    qp = QP(
        P=P,
        g=-(wanted @ stacked),
        A=A,
        b=b,
        C=bounds.matrix,
        l=bounds.lower,
        u=bounds.upper,
        lower=lower,
        upper=upper,
        labels=labels,
    )
    return qp if bounds.slack is None else with_slack(qp, bounds.slack)


@cache
def _none(n: int) -> Bounds:
    """Return no rows for n unknowns."""
    return Bounds((), np.zeros((0, n)), np.zeros(0), np.zeros(0))


def with_slack(qp: QP, weights: Array) -> QP:
    """Return the QP with a slack variable for each inequality row that may give way.

    ``l <= C x - s <= u`` at the cost of 1/2 weight s^2. The slacks are unknowns behind x, named
    after their rows.

    Parameters
    ----------
    weights:
        (mi,), infinite for rows that may not give way.
    """
    soft = np.flatnonzero(np.isfinite(weights))
    n, k = qp.g.size, soft.size
    P = np.zeros((n + k, n + k))
    P[:n, :n] = qp.P
    P.flat[n * (n + k + 1) :: n + k + 1] = weights[soft]
    give = np.zeros((qp.u.size, k))
    give[soft, np.arange(k)] = -1.0
    free = np.full(k, np.inf)
    names = tuple(f"{SLACK_OF}{qp.labels.inequality[row]}" for row in soft)
    return QP(
        P=P,
        g=np.concatenate((qp.g, np.zeros(k))),
        A=np.concatenate((qp.A, np.zeros((qp.b.size, k))), axis=1),
        b=qp.b,
        C=np.concatenate((qp.C, give), axis=1),
        l=qp.l,
        u=qp.u,
        lower=np.concatenate((qp.lower, -free)),
        upper=np.concatenate((qp.upper, free)),
        labels=Labels(qp.labels.equality, qp.labels.inequality, qp.labels.variables + names),
    )


def slacks(qp: QP, x: Array) -> dict[str, float]:
    """Return by how much each row that may give way has given way, by its name."""
    if not qp.labels.variables[-1].startswith(SLACK_OF):  # most ticks: slacks are the last unknowns
        return {}
    return {
        name.removeprefix(SLACK_OF): float(x[k])
        for k, name in enumerate(qp.labels.variables)
        if name.startswith(SLACK_OF) and abs(x[k]) > GIVEN_WAY
    }


def _weighted(costs: Sequence[Rows]) -> tuple[Array, Array]:
    """Return all rows times their weights, stacked: one product is cheaper than one per task."""
    stacked = np.concatenate([rows.matrix for rows in costs])
    weight = np.concatenate([rows.weight for rows in costs])
    stacked *= weight[:, None]
    return stacked, weight * np.concatenate([rows.target for rows in costs])


def convexified(H: Array) -> Array:
    """Return the nearest thing to H (n, n) that a QP can use: its eigenvalues made positive.

    Taking their absolute values keeps the Newton step where H is convex and leaves a saddle by the
    direction of negative curvature at the same scale (Dauphin et al. 2014, "saddle-free Newton").
    """
    values, vectors = np.linalg.eigh(0.5 * (H + H.T))
    sizes = np.abs(values)
    np.maximum(sizes, FLATTEST * sizes.max(), out=sizes)
    half = vectors * np.sqrt(sizes)
    return half @ half.T
