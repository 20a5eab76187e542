"""The closest command and the irreducible conflict, against linear programs and PIQP."""

import numpy as np
import pytest
import qpsolvers
from scipy.optimize import linprog

from wbc.qp import QP, Labels, find_conflict
from wbc.qp.conflict import REACH, irreducible
from wbc.qp.least_infeasible import least_infeasible


def contradicted(solvable, seed: int) -> QP:
    """Return a QP made infeasible by two rows that each contradict something."""
    rng = np.random.default_rng(seed)
    qp = solvable(rng, n=8, me=2, mi=4)
    qp = qp._replace(lower=np.full(8, -2.0), upper=np.full(8, 2.0))
    far = rng.normal(size=8)
    gap = rng.uniform(0.1, 2.0)
    mixture = rng.normal(size=2) @ qp.A
    return qp._replace(
        A=np.vstack((qp.A, mixture)),
        b=np.append(qp.b, mixture @ rng.normal(size=8)),
        C=np.vstack((qp.C, far)),
        l=np.append(qp.l, 2.0 * np.abs(far).sum() + gap),
        u=np.append(qp.u, np.inf),
        labels=Labels.numbered(8, 3, 5),
    )


def feasible(qp: QP) -> bool:
    """Whether any x meets every row, by HiGHS."""
    upper, lower = np.isfinite(qp.u), np.isfinite(qp.l)
    result = linprog(
        np.zeros(qp.g.size),
        A_ub=np.concatenate((qp.C[upper], -qp.C[lower])),
        b_ub=np.concatenate((qp.u[upper], -qp.l[lower])),
        A_eq=qp.A,
        b_eq=qp.b,
        # Unknowns without bounds stay within reach, as conflicts are defined.
        bounds=list(zip(np.maximum(qp.lower, -REACH), np.minimum(qp.upper, REACH), strict=True)),
    )
    assert result.status in (0, 2), result.message
    return result.status == 0


def least_violation(qp: QP) -> float:
    """Return the least sum of squared violations of the rows, each scaled to unit length."""
    n, me, m = qp.g.size, qp.b.size, qp.b.size + qp.u.size
    rows = np.concatenate((qp.A, qp.C))
    length = np.linalg.norm(rows, axis=1)
    rows = rows / length[:, None]
    P = np.zeros((n + m, n + m))
    P[n:, n:] = 2.0 * np.eye(m)
    relaxed = np.concatenate((rows, -np.eye(m)), axis=1)
    above, below = np.isfinite(qp.u), np.isfinite(qp.l)
    G = np.concatenate((relaxed[me:][above], -relaxed[me:][below]))
    h = np.concatenate(((qp.u / length[me:])[above], -(qp.l / length[me:])[below]))
    free = np.full(m, np.inf)
    problem = qpsolvers.Problem(
        P, np.zeros(n + m), G, h, relaxed[:me], qp.b / length[:me],
        np.concatenate((qp.lower, -free)), np.concatenate((qp.upper, free)),
    )  # fmt: skip
    answer = qpsolvers.solve_problem(problem, "piqp")
    assert answer.found
    return float(np.square(answer.x[n:]).sum())


@pytest.mark.parametrize("seed", range(20))
def test_violates_as_little_as_can_be_and_stays_within_the_bounds(solvable, seed: int) -> None:
    qp = contradicted(solvable, seed)
    assert not feasible(qp)
    found = least_infeasible(qp)
    assert (found.x >= qp.lower).all() and (found.x <= qp.upper).all()
    rows = np.concatenate((qp.A, qp.C))
    length = np.linalg.norm(rows, axis=1)
    values = qp.C @ found.x
    miss = np.concatenate((qp.A @ found.x - qp.b, values - np.clip(values, qp.l, qp.u))) / length
    # PIQP's own accuracy is about 1e-8 of the sum.
    assert np.square(miss).sum() == pytest.approx(least_violation(qp), rel=1e-6)
    assert "inequality 4" in found.slack
    assert found.slack["inequality 4"] < 0.0


@pytest.mark.parametrize("seed", range(20))
def test_among_the_closest_the_cost_is_least(solvable, seed: int) -> None:
    qp = contradicted(solvable, seed)
    found = least_infeasible(qp)
    assert found.optimal
    # Every row opened by what was missed, solved anew by another solver.
    values = qp.C @ found.x
    opened = qpsolvers.Problem(
        qp.P, qp.g,
        np.concatenate((qp.C, -qp.C)),
        np.concatenate((np.maximum(qp.u, values), -np.minimum(qp.l, values))),
        qp.A, qp.A @ found.x, qp.lower, qp.upper,
    )  # fmt: skip
    kept = np.isfinite(opened.h)
    opened.G, opened.h = opened.G[kept], opened.h[kept]
    answer = qpsolvers.solve_problem(opened, "piqp")
    assert answer.found

    def cost(x):
        return 0.5 * x @ qp.P @ x + qp.g @ x

    # PIQP meets the rows to 1e-8 only; with multipliers of up to 1e3 that moves the cost.
    scale = np.abs(qp.g).max() * (1.0 + np.abs(found.x).max())
    assert cost(found.x) == pytest.approx(cost(answer.x), rel=1e-6, abs=1e-6 * scale)


@pytest.mark.parametrize("seed", range(5))
def test_of_a_feasible_qp_it_is_the_solution(solvable, seed: int) -> None:
    qp = solvable(np.random.default_rng(seed))
    found = least_infeasible(qp)
    assert found.optimal and not found.slack
    kept_u, kept_l = np.isfinite(qp.u), np.isfinite(qp.l)
    reference = qpsolvers.solve_qp(
        qp.P, qp.g,
        np.concatenate((qp.C[kept_u], -qp.C[kept_l])),
        np.concatenate((qp.u[kept_u], -qp.l[kept_l])),
        qp.A, qp.b, qp.lower, qp.upper, solver="piqp",
    )  # fmt: skip
    np.testing.assert_allclose(found.x, reference, atol=1e-5)


def without(qp: QP, rows) -> QP:
    """Return ``qp`` without the given sides of rows and bounds."""
    parts = {key: getattr(qp, key).copy() for key in ("l", "u", "lower", "upper")}
    equal = np.ones(qp.b.size, dtype=bool)
    for row in rows:
        if row.side == "equality":
            equal[qp.labels.equality.index(row.label)] = False
        elif "limit" in row.side:
            k = qp.labels.inequality.index(row.label)
            parts["u" if "upper" in row.side else "l"][k] *= np.inf
        else:
            k = qp.labels.variables.index(row.label)
            key = "upper" if "upper" in row.side else "lower"
            parts[key][k] = np.inf if key == "upper" else -np.inf
    names = tuple(np.array(qp.labels.equality)[equal])
    labels = Labels(names, qp.labels.inequality, qp.labels.variables)
    return qp._replace(A=qp.A[equal], b=qp.b[equal], labels=labels, **parts)


@pytest.mark.parametrize("seed", range(12))
def test_every_row_of_an_irreducible_conflict_is_to_blame(solvable, seed: int) -> None:
    rng = np.random.default_rng(seed)
    qp = solvable(rng, n=8, me=2, mi=4)
    qp = qp._replace(lower=np.full(8, -2.0), upper=np.full(8, 2.0))
    # Against three bounds; none of them so little that it could be met far away instead.
    slope = rng.uniform(0.5, 1.5, size=8) * rng.choice((-1.0, 1.0), size=8)
    far = np.where(np.arange(8) < 3, slope, 0.0)
    qp = qp._replace(
        C=np.vstack((qp.C, far)),
        l=np.append(qp.l, 2.0 * np.abs(far).sum() + 0.3),
        u=np.append(qp.u, np.inf),
        labels=Labels.numbered(8, 2, 5),
    )
    conflict = find_conflict(qp)
    assert conflict is not None
    small = irreducible(qp, conflict)
    assert 1 < len(small.rows) <= len(conflict.rows)
    named = {(row.label, row.side) for row in small.rows}
    assert named <= {(row.label, row.side) for row in conflict.rows}
    everything = [row for row in conflict_of_everything(qp) if (row.label, row.side) not in named]
    alone = without(qp, everything)
    assert not feasible(alone)
    for row in small.rows:
        assert feasible(without(alone, [row])), f"{row.label} is not needed"


def conflict_of_everything(qp: QP):
    """Return every side of every row and bound, as rows of a conflict."""
    from wbc.qp import ConflictRow

    names = qp.labels
    rows = [ConflictRow(name, 0.0, 1.0, "equality") for name in names.equality]
    for name in names.inequality:
        k = names.inequality.index(name)
        if np.isfinite(qp.u[k]):
            rows.append(ConflictRow(name, 0.0, 1.0, "upper limit"))
        if np.isfinite(qp.l[k]):
            rows.append(ConflictRow(name, 0.0, 1.0, "lower limit"))
    for name in names.variables:
        rows += [ConflictRow(name, 0.0, 1.0, f"{side} bound") for side in ("lower", "upper")]
    return rows
