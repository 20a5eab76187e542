"""The closest command, against linear programs and PIQP."""

import numpy as np
import pytest
import qpsolvers
from conflict_judge import can_hold

from wbc.qp import QP, Labels
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
    assert not can_hold(qp)
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
