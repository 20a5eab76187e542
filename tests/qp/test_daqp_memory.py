"""DAQP on kept memory: DAQP's own bits, nothing left of the QP before, nothing let through."""

from threading import Thread

import daqp
import numpy as np
import pytest

from tests.needs import needs_direct_daqp
from wbc.errors import InvalidInputError
from wbc.native import VARIABLE
from wbc.qp import QP, Status, daqp_direct, make_backend
from wbc.qp import daqp_memory as kept
from wbc.qp.daqp import Daqp
from wbc.qp.daqp_direct import DirectDaqp
from wbc.qp.kkt import MOST, PerThread, SolveCheck
from wbc.qp.solution import RawSolution

SIZES = (
    (7, 0, 0),
    (7, 5, 0),
    (7, 0, 2),
    (12, 6, 3),
    (20, 0, 6),
)  # unknowns, inequalities, equalities


@pytest.fixture(autouse=True)
def _without_the_core(monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, "off")
    monkeypatch.setattr(kept, "_PER_THREAD", PerThread())


def random_qp(rng: np.random.Generator, n: int, mi: int, me: int) -> QP:
    """Return a feasible QP in whose solution some bounds and rows are active."""
    root, inside = rng.normal(size=(n, n)), 0.1 * rng.normal(size=n)
    A, C = rng.normal(size=(me, n)), rng.normal(size=(mi, n))
    return QP.build(
        root.T @ root + 0.1 * np.eye(n),
        4.0 * rng.normal(size=n),
        A=A,
        b=A @ inside,
        C=C,
        l=C @ inside - 0.3,
        u=C @ inside + 0.3,
        lower=inside - 0.5,
        upper=inside + 0.5,
    )


def by_daqp(qp: QP, **settings: int) -> tuple[np.ndarray, np.ndarray]:
    """Return solution and multipliers by DAQP's own interface."""
    sense = np.zeros(qp.g.size + qp.u.size + qp.b.size, dtype=np.intc)
    sense[qp.g.size + qp.u.size :] = 5
    rows = np.vstack((qp.C, qp.A))
    upper, lower = np.hstack((qp.upper, qp.u, qp.b)), np.hstack((qp.lower, qp.l, qp.b))
    x, _, flag, info = daqp.solve(
        qp.P, qp.g, rows, upper, lower, sense, primal_tol=1e-9, iter_limit=1000, **settings
    )
    assert flag == 1
    return x, info["lam"]


@pytest.mark.parametrize("direct", [True, False])
def test_answers_are_those_of_daqp_to_the_bit(direct, monkeypatch) -> None:
    if not direct:
        monkeypatch.setattr(kept, "direct_daqp", lambda: DirectDaqp(0, "not here"))
    rng = np.random.default_rng(5)
    solver, active, found = Daqp(), 0, []
    for _ in range(20):
        for size in SIZES:  # in turns: memory is used again
            qp = random_qp(rng, *size)
            # Equalities are not eliminated where there are no other rows.
            settings = {} if qp.u.size or not direct else {"eq_reduction": -1}
            x, multipliers = by_daqp(qp, **settings)
            solution = solver.solve(qp)
            assert solution.status is Status.SOLVED
            assert np.array_equal(solution.x, x)
            joined = np.hstack((solution.z_box, solution.z, solution.y))
            assert np.array_equal(joined, multipliers)
            active += int(np.count_nonzero(solution.z_box)) + int(np.count_nonzero(solution.z))
            found.append((solution.x, x))
    assert active > 100
    for ours, theirs in found:  # a later solve does not change what was answered
        assert np.array_equal(ours, theirs)


@needs_direct_daqp
@pytest.mark.parametrize("place", ["_ITERATIONS", "_REDUCTION", "_ZERO"])
def test_settings_in_another_place_are_noticed(place, monkeypatch) -> None:
    """Then DAQP is called through Python."""
    monkeypatch.setattr(daqp_direct, place, 33)
    assert not daqp_direct.direct_daqp.__wrapped__().address


def test_threads_do_not_share_memory() -> None:
    rng = np.random.default_rng(6)
    qps = [random_qp(rng, 12, 6, 3) for _ in range(4)]
    expected = [by_daqp(qp)[0] for qp in qps]
    wrong: list[int] = []

    def solve(k: int) -> None:
        solver = Daqp()
        for _ in range(300):
            if not np.array_equal(solver.solve(qps[k]).x, expected[k]):
                wrong.append(k)

    threads = [Thread(target=solve, args=(k,)) for k in range(len(qps))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_memory_for_many_sizes_is_bounded() -> None:
    rng = np.random.default_rng(7)
    solver = Daqp()
    for mi in range(MOST + 10):
        assert solver.solve(random_qp(rng, 5, mi, 0)).solved
    assert 0 < len(kept._PER_THREAD.kept) <= MOST


@pytest.mark.parametrize("field", ["P", "g", "A", "b", "C", "l", "u", "lower", "upper"])
@pytest.mark.parametrize("entry", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["daqp", "proxqp"])
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
@pytest.mark.parametrize("name", ["daqp", "proxqp"])
def test_bounds_that_cross_are_refused(name, quick) -> None:
    qp = random_qp(np.random.default_rng(9), 7, 5, 2)
    solver = make_backend(name)
    assert solver.solve(qp).solved
    qp.lower[3] = qp.upper[3] + 1e-6
    with pytest.raises(InvalidInputError, match="which no number does"):
        solver.solve(qp, quick=quick)


@pytest.mark.parametrize("field", ["y", "z", "z_box"])
def test_multipliers_that_are_no_numbers_are_no_evidence(field) -> None:
    qp = random_qp(np.random.default_rng(10), 7, 5, 2)
    raw = Daqp().answer(qp)
    check = SolveCheck("none", 1e-8, 0.0)
    assert check.accept(qp, raw) is not None
    parts = {name: getattr(raw, name).copy() for name in ("x", "y", "z", "z_box")}
    parts[field][-1] = np.nan
    assert check.accept(qp, RawSolution(**parts, claim=Status.SOLVED)) is None
