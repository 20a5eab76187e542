"""Answers of every backend: shapes, finite numbers, counts and words; what is no QP is refused."""

from itertools import product
from threading import Thread

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.qp import QP, installed_solvers, make_backend
from wbc.qp.active_set import ActiveSet
from wbc.qp.kkt import SolveCheck
from wbc.qp.least_infeasible import least_infeasible
from wbc.qp.problem import Labels
from wbc.qp.solution import Conflict, ConflictRow, KktResiduals, RawSolution, Solution, Status

EVERY = (*installed_solvers(), "pseudo_inverse")
OURS = ("active_set", "proxqp", "proxqp_cold")


@pytest.mark.parametrize(
    ("name", "me", "mi"),
    [
        *product(EVERY, (0, 2), (0,)),
        *product(installed_solvers(), (0, 2), (3,)),  # the pseudo-inverse keeps no inequality rows
    ],
)
def test_points_and_multipliers_have_the_sizes_of_the_qp(name, me, mi, solvable) -> None:
    qp = solvable(np.random.default_rng(3), me=me, mi=mi)
    found = make_backend(name).solve(qp)
    assert found.solved or name == "pseudo_inverse"
    sizes = {"x": 8, "y": me, "z": mi, "z_box": 8}
    assert {key: getattr(found, key).shape for key in sizes} == {k: (n,) for k, n in sizes.items()}
    assert all(np.isfinite(getattr(found, key)).all() for key in sizes)
    assert found.attempts >= 1 and 0.0 < found.solve_time < 60.0  # no clock's reading


def test_the_pseudo_inverse_is_the_damped_one_clipped(rng) -> None:
    """Oracle: the normal equations in the null space of A by SVD, then the bounds."""
    A, J = rng.normal(size=(2, 6)), rng.normal(size=(9, 6))
    P, g = J.T @ J, rng.normal(size=6)
    null = np.linalg.svd(A)[2][2:].T
    expected = null @ np.linalg.solve(null.T @ P @ null, -null.T @ g)
    free = QP.build(P, g, A=A, b=np.zeros(2))
    np.testing.assert_allclose(make_backend("pseudo_inverse").solve(free).x, expected, atol=1e-10)
    unconstrained = np.linalg.solve(P, -g)
    ends = np.abs(unconstrained).mean()
    clipped = make_backend("pseudo_inverse").solve(
        QP.build(P, g, lower=[-ends] * 6, upper=[ends] * 6)
    )
    np.testing.assert_allclose(clipped.x, np.clip(unconstrained, -ends, ends), atol=1e-12)
    pulled = np.abs(unconstrained) > ends
    np.testing.assert_allclose(clipped.z_box[pulled], -(P @ clipped.x + g)[pulled], atol=1e-12)
    assert pulled.any() and not clipped.z_box[~pulled].any() and clipped.iterations == 1
    with pytest.raises(InvalidInputError, match=r"QP\.g"):
        make_backend("pseudo_inverse").solve(QP.build(P, [*g[:5], np.nan]))


def test_only_rows_that_are_missed_are_named_in_their_own_units() -> None:
    """To 1e-7 of a row's length and of 1 + |x|; a row of zeros counts as one of length 1."""
    labels = Labels(("far", "zero"), ("below", "met"), ("a", "b"))
    qp = QP.build(np.eye(2), np.zeros(2), A=[[100.0, 0.0], [0.0, 0.0]], b=[300.0, 4.0],
                  C=[[0.0, 2.0], [0.0, 1.0]], l=[5.0, -1.0], u=[6.0, 1.5],
                  lower=[-1.0, -1.0], upper=[1.0, 2.0], labels=labels)  # fmt: skip
    found = least_infeasible(qp)
    assert found.x[0] == 1.0
    assert found.slack["far"] == pytest.approx(-200.0) and found.slack["zero"] == pytest.approx(
        -4.0
    )
    # The two rows on b meet half-way, in rows of unit length: 2.5 and 1.5, so b is 2 = its bound.
    assert found.x[1] == pytest.approx(2.0) and found.slack["below"] == pytest.approx(-1.0)
    assert found.slack["met"] == pytest.approx(0.5)
    near = QP.build(np.eye(1), [0.0], A=[[1.0], [1.0]], b=[1.0, 1.0 + 1e-8])
    assert not least_infeasible(near).slack


WORDS = {  # said when a test asks, not here
    "equality": (ConflictRow("a", 0.5, 1.0), "'a', missed by 0.5"),
    "bound": (ConflictRow("x", 0.0, 1.0, "upper bound"), "'x' (upper bound)"),
    "small": (ConflictRow("x", 1e-9, 1.0, "lower limit"),
              "'x' (lower limit), missed by 1e-09"),
    "no more": (Conflict(tuple(ConflictRow(str(k), 0.0, 1.0) for k in range(6))),
                "these cannot all hold: '0'; '1'; '2'; '3'; '4'; '5'"),
    "one more": (Conflict(tuple(ConflictRow(str(k), 0.0, 1.0) for k in range(7))),
                 "these cannot all hold: '0'; '1'; '2'; '3'; '4'; '5'; and 1 more"),
}  # fmt: skip


@pytest.mark.parametrize("case", WORDS)
def test_conflicts_in_words(case: str) -> None:
    told, expected = WORDS[case]
    assert told.describe() == expected


def test_as_many_rows_are_told_as_are_asked_for() -> None:
    conflict = Conflict(tuple(ConflictRow(str(k), 0.0, 1.0) for k in range(4)))
    assert conflict.describe(1) == "these cannot all hold: '0'; and 3 more"


def test_a_solution_in_words() -> None:
    none, residuals = np.zeros(0), KktResiduals(1e-9, 2e-8, 3e-7)
    one = Solution(np.zeros(3), none, none, none, Status.FAILED, residuals, 7, 0.1, "active_set")
    assert one.describe() == (
        "active_set: failed after 7 iterations in attempt 1 (primal residual 1.0e-09, dual 2.0e-08,"
        " complementarity 3.0e-07)"
    )
    assert not one.solved
    assert repr(one) == "Solution(failed by active_set, 3 variables, 7 iterations)"
    qp = QP.build(np.eye(2), np.ones(2), C=np.ones((1, 2)), u=[1.0], A=np.ones((1, 2)), b=[0.0])
    assert repr(qp) == "QP(2 variables, 1 equalities, 1 inequalities)"
    raw = RawSolution.none(qp, Status.INFEASIBLE, "no way")
    assert [len(part) for part in (raw.x, raw.y, raw.z, raw.z_box)] == [2, 1, 1, 2]
    assert np.isnan(raw.x).all() and np.isnan(raw.z).all() and raw.iterations == 0
    assert Labels.numbered(2, 1, 1).variables == ("x0", "x1")
    assert Labels.numbered(2) == Labels((), (), ("x0", "x1"))


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


@pytest.mark.parametrize("name", OURS)
def test_a_later_solve_does_not_change_what_was_answered(name: str) -> None:
    """Of QPs of one size and of several, in turns: memory is used again."""
    rng, solver, found = np.random.default_rng(5), make_backend(name), []
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
