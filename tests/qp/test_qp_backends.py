"""Every installed backend against two oracles that share no code with it, and each other."""

import itertools

import numpy as np
import pytest

from wbc.qp import QP, Status, installed_solvers, make_backend

BACKENDS = installed_solvers()
# eps = 1e-8 bounds the residuals; with P's eigenvalues above 1e-3 the point itself is within
# 1e-8 / 1e-3, and ADMM and interior points use that up.
POINT = 2e-5


def enumerated(qp: QP) -> np.ndarray:
    """Return the optimum by trying every active set: slow, and with nothing to converge."""
    n = qp.g.size
    rows = np.concatenate((qp.C, np.eye(n)))
    ends = [
        (row, bound, sign)
        for lower, upper, row in zip(
            np.concatenate((qp.l, qp.lower)), np.concatenate((qp.u, qp.upper)), rows, strict=True
        )
        for bound, sign in ((upper, 1.0), (lower, -1.0))
        if np.isfinite(bound)
    ]
    for count in range(n - qp.b.size + 1):
        for active in itertools.combinations(ends, count):
            A = np.concatenate((qp.A, [row for row, _, _ in active])) if active else qp.A
            b = np.concatenate((qp.b, [bound for _, bound, _ in active]))
            K = np.block([[qp.P, A.T], [A, np.zeros((len(b), len(b)))]])
            if np.linalg.matrix_rank(K) < len(K):
                continue
            point = np.linalg.solve(K, np.concatenate((-qp.g, b)))
            x, multipliers = point[:n], point[n + qp.b.size :]
            signs = np.array([sign for _, _, sign in active])
            met = all(sign * (row @ x - bound) < 1e-9 for row, bound, sign in ends)
            if met and (multipliers * signs > -1e-9).all():
                return x
    raise AssertionError("the enumeration found no optimum")


@pytest.fixture(params=BACKENDS)
def backend(request):
    return make_backend(request.param)


@pytest.mark.parametrize("seed", range(12))
def test_against_enumeration(backend, solvable, seed):
    qp = solvable(np.random.default_rng(seed), n=3, me=seed % 2, mi=2)
    solution = backend.solve(qp)
    assert solution.status is Status.SOLVED, solution.describe()
    np.testing.assert_allclose(solution.x, enumerated(qp), atol=POINT)


# One constraint of each kind, active at a known side; P = I, so every multiplier is known:
# x + g + A'y + C'z + z_box = 0.
SIGNS = {
    "nothing": (QP.build([[2.0, 0.5], [0.5, 1.0]], [1, -1]), [-6 / 7, 10 / 7], [], [], [0, 0]),
    "equality": (QP.build(np.eye(2), [0, 0], A=[[1, 1]], b=[2]), [1, 1], [-1], [], [0, 0]),
    "row at upper": (QP.build(np.eye(2), [-3, 0], C=[[1, 0]], u=[1]), [1, 0], [], [2], [0, 0]),
    "row at lower": (QP.build(np.eye(2), [3, 0], C=[[1, 0]], l=[-1]), [-1, 0], [], [-2], [0, 0]),
    "two-sided row": (
        QP.build(np.eye(2), [3, 0], C=[[1, 0]], l=[-1], u=[5]), [-1, 0], [], [-2], [0, 0]),
    "row that is an equality": (
        QP.build(np.eye(2), [3, 0], C=[[1, 0]], l=[-1], u=[-1]), [-1, 0], [], [-2], [0, 0]),
    "bound at upper": (QP.build(np.eye(2), [-3, 0], upper=[1, 9]), [1, 0], [], [], [2, 0]),
    "bound at lower": (QP.build(np.eye(2), [0, 3], lower=[-9, -1]), [0, -1], [], [], [0, -2]),
    "fixed variable": (
        QP.build(np.eye(2), [0, 3], lower=[-9, -1], upper=[9, -1]), [0, -1], [], [], [0, -2]),
    "all at once": (
        QP.build(np.eye(4), [0, 0, -3, 3], A=[[1, 0, 0, 0]], b=[5], C=[[0, 1, 0, 0], [0, 0, 1, 0]],
                 l=[2, -9], u=[9, 1], lower=[-np.inf, -np.inf, -np.inf, -1]),
        [5, 2, 1, -1], [-5], [-2, 2], [0, 0, 0, -2]),
}  # fmt: skip


@pytest.mark.parametrize("case", SIGNS)
def test_multipliers_have_our_signs(backend, case):
    qp, *expected = SIGNS[case]
    solution = backend.solve(qp)
    assert solution.solved, solution.describe()
    for found, wanted in zip(solution[:4], expected, strict=True):
        # P = I: errors in x and in the multipliers are the residuals, eps (1 + 5) at most.
        np.testing.assert_allclose(found, wanted, atol=1e-7)


@pytest.mark.parametrize("name", [n for n in BACKENDS if n != "osqp"])
def test_three_hundred_solvable_problems_are_solved(name, solvable):
    """No false "infeasible": each has a known feasible point, with a third of the limits tight."""
    backend = make_backend(name)
    rng = np.random.default_rng(2024)
    count = 300 if name.startswith("proxqp") or name in ("active_set", "daqp") else 60
    for k in range(count):
        n = int(rng.integers(2, 20))
        qp = solvable(rng, n=n, me=int(rng.integers(0, n // 2 + 1)), mi=int(rng.integers(0, 9)))
        solution = backend.solve(qp, workspace=(n, k % 3))
        assert solution.solved, (k, solution.describe())
