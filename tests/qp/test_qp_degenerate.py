"""Rows that repeat, vanish or depend on each other; costs that leave directions free."""

import numpy as np
import pytest

from wbc.qp import QP, installed_solvers, make_backend

# Quadprog and Clarabel factorise the equality rows and say so when these depend on each other.
ROBUST = [n for n in installed_solvers() if n in ("active_set", "piqp", "proxqp", "proxqp_cold")]


@pytest.fixture(params=ROBUST)
def backend(request):
    return make_backend(request.param)


def repeated(qp):
    A, b = np.array(qp.A), np.array(qp.b)
    A[5], b[5] = A[4], b[4]
    return qp._replace(A=A, b=b)


def dependent(qp):
    A, b = np.array(qp.A), np.array(qp.b)
    A[5], b[5] = A[3] - 2.0 * A[4], b[3] - 2.0 * b[4]
    return qp._replace(A=A, b=b)


def vanishing(qp):
    A = np.array(qp.A)
    A[5] = 0.0
    return qp._replace(A=A)


def repeated_inequality(qp):
    C, u = np.array(qp.C), np.array(qp.u)
    C[1], u[1] = C[0], u[0]
    C[2], u[2] = qp.A[0], 0.0
    return qp._replace(C=C, u=u)


@pytest.mark.parametrize("spoil", [repeated, dependent, vanishing, repeated_inequality])
def test_redundant_rows_change_nothing(backend, ticks, spoil):
    for qp in ticks(seed=6, count=5, mi=10):
        spoiled = spoil(qp)
        keep = [k for k in range(12) if k != 5] if spoil is not repeated_inequality else range(12)
        rows = [k for k in range(10) if k not in (1, 2)]
        if spoil is not repeated_inequality:
            rows = range(10)
        plain = QP.build(
            spoiled.P, spoiled.g, A=spoiled.A[keep], b=spoiled.b[keep], C=spoiled.C[rows],
            u=spoiled.u[rows], lower=spoiled.lower, upper=spoiled.upper,
        )  # fmt: skip
        solution, expected = backend.solve(spoiled), make_backend("proxqp_cold").solve(plain)
        assert solution.solved, solution.describe()
        # P's smallest eigenvalue is 1e-4: residuals of 1e-9 leave 1e-5 in the point.
        np.testing.assert_allclose(solution.x, expected.x, atol=1e-5)


def test_more_equalities_than_unknowns():
    """Sixteen consistent rows for eight unknowns leave one point."""
    rng = np.random.default_rng(0)
    A, point = rng.normal(size=(16, 8)), rng.normal(size=8)
    solution = make_backend("proxqp").solve(QP.build(np.eye(8), np.ones(8), A=A, b=A @ point))
    assert solution.solved, solution.describe()
    np.testing.assert_allclose(solution.x, point, atol=1e-7)


def test_singular_cost_with_bounds(backend):
    """Only x0 + x1 has a cost: any split is optimal, and the sum is what counts."""
    qp = QP.build([[1.0, 1.0], [1.0, 1.0]], [-1.0, -1.0], lower=[-2.0, -2.0], upper=[2.0, 2.0])
    solution = backend.solve(qp)
    assert solution.solved, solution.describe()
    assert solution.x.sum() == pytest.approx(1.0, abs=1e-7)


def test_all_unknowns_fixed(backend):
    qp = QP.build(np.eye(3), np.ones(3), lower=[1.0, 2.0, 3.0], upper=[1.0, 2.0, 3.0])
    solution = backend.solve(qp)
    assert solution.solved, solution.describe()
    np.testing.assert_allclose(solution.x, [1.0, 2.0, 3.0], atol=1e-7)


@pytest.mark.parametrize("rows", [0, 4])
def test_read_only_arrays(backend, solvable, rows: int) -> None:
    """What is planned once is shared and read-only; Cython's solvers ask for writable arrays."""
    qp = solvable(np.random.default_rng(0), mi=rows)
    frozen = {name: np.array(getattr(qp, name)) for name in ("P", "g", "A", "b", "C", "l", "u")}
    for array in frozen.values():
        array.flags.writeable = False
    solution = backend.solve(qp._replace(**frozen))
    np.testing.assert_allclose(solution.x, backend.solve(qp).x, atol=1e-7)
