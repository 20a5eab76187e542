"""What is no QP is refused by every solver of our own, cold or warm, and nothing is let through."""

from threading import Thread

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.qp import QP, Status, make_backend
from wbc.qp.active_set import ActiveSet
from wbc.qp.kkt import SolveCheck
from wbc.qp.solution import RawSolution

OURS = ("active_set", "proxqp", "proxqp_cold")


def random_qp(rng: np.random.Generator, n: int, mi: int, me: int) -> QP:
    """Return a feasible QP in whose solution some bounds and rows are active."""
    root, inside = rng.normal(size=(n, n)), 0.1 * rng.normal(size=n)
    A, C = rng.normal(size=(me, n)), rng.normal(size=(mi, n))
    return QP.build(
        root.T @ root + 0.1 * np.eye(n), 4.0 * rng.normal(size=n), A=A, b=A @ inside, C=C,
        l=C @ inside - 0.3, u=C @ inside + 0.3, lower=inside - 0.5, upper=inside + 0.5,
    )  # fmt: skip


def test_threads_do_not_share_memory() -> None:
    rng = np.random.default_rng(6)
    qps = [random_qp(rng, 12, 6, 3) for _ in range(4)]
    expected = [ActiveSet().solve(qp).x for qp in qps]
    wrong: list[int] = []

    def solve(k: int) -> None:
        solver = ActiveSet()
        for _ in range(300):
            if not np.array_equal(solver.solve(qps[k]).x, expected[k]):
                wrong.append(k)

    threads = [Thread(target=solve, args=(k,)) for k in range(len(qps))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_a_later_solve_does_not_change_what_was_answered() -> None:
    """Of QPs of one size and of several, in turns: memory is used again."""
    rng, solver, found = np.random.default_rng(5), ActiveSet(), []
    for _ in range(10):
        for size in ((7, 0, 0), (7, 5, 0), (7, 0, 2), (12, 6, 3), (20, 0, 6)):
            solution = solver.solve(random_qp(rng, *size))
            assert solution.solved
            found.append((solution, [part.copy() for part in solution[:4]]))
    for solution, parts in found:
        for ours, kept in zip(solution[:4], parts, strict=True):
            np.testing.assert_array_equal(ours, kept)


@pytest.mark.parametrize("field", ["P", "g", "A", "b", "C", "l", "u", "lower", "upper"])
@pytest.mark.parametrize("entry", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", OURS)
def test_what_is_no_number_is_refused(field, entry, name) -> None:
    if (field in ("l", "lower") and entry == -np.inf) or (
        field in ("u", "upper") and entry == np.inf
    ):
        entry = np.nan  # those are bounds
    qp = random_qp(np.random.default_rng(8), 7, 5, 2)
    solver = make_backend(name)
    assert solver.solve(qp).solved  # ProxQP is warm from here on
    broken = getattr(qp, field).copy()
    broken.flat[-1] = entry
    qp = qp._replace(**{field: broken})
    with pytest.raises(InvalidInputError, match=rf"QP\.{field}"):
        solver.solve(qp)


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize("name", OURS)
def test_bounds_that_cross_are_refused(name, quick) -> None:
    qp = random_qp(np.random.default_rng(9), 7, 5, 2)
    solver = make_backend(name)
    assert solver.solve(qp).solved
    qp.lower[3] = qp.upper[3] + 1e-6
    with pytest.raises(InvalidInputError, match="which no number does"):
        solver.solve(qp, quick=quick)


@pytest.mark.parametrize("field", ["P", "g", "A", "b", "C", "l", "u", "lower", "upper"])
@pytest.mark.parametrize("name", OURS)
def test_sizes_that_do_not_fit_are_refused(field: str, name: str) -> None:
    """A row fewer, not read beyond: by name, also where the solver is warm."""
    qp = random_qp(np.random.default_rng(8), 7, 5, 2)
    solver = make_backend(name)
    assert solver.solve(qp).solved
    with pytest.raises(InvalidInputError, match=r"QP\."):
        solver.solve(qp._replace(**{field: getattr(qp, field)[:-1]}))


@pytest.mark.parametrize("field", ["y", "z", "z_box"])
def test_multipliers_that_are_no_numbers_are_no_evidence(field) -> None:
    qp = random_qp(np.random.default_rng(10), 7, 5, 2)
    raw = ActiveSet().answer(qp)
    nowhere = qp._replace(lower=np.full(7, 9e3), upper=np.full(7, 1e4))
    assert ActiveSet().answer(nowhere).claim is Status.INFEASIBLE
    assert ActiveSet(max_iterations=1).answer(qp).claim is Status.ITERATION_LIMIT
    check = SolveCheck("none", 1e-8, 0.0)
    assert check.accept(qp, raw) is not None
    parts = {name: getattr(raw, name).copy() for name in ("x", "y", "z", "z_box")}
    parts[field][-1] = np.nan
    assert check.accept(qp, RawSolution(**parts, claim=Status.SOLVED)) is None
