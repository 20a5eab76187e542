"""Answers of every backend: shapes, finite numbers, refusals, counts of attempts, and words."""

from itertools import product

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.qp import QP, installed_solvers, make_backend
from wbc.qp.conflict import least_violation
from wbc.qp.daqp import Daqp, KeptDaqp, _raw
from wbc.qp.least_infeasible import least_infeasible
from wbc.qp.problem import Labels
from wbc.qp.solution import Conflict, ConflictRow, KktResiduals, RawSolution, Solution, Status

EVERY = (*installed_solvers(), "pseudo_inverse")


@pytest.mark.parametrize(
    ("name", "me", "mi"),
    [
        *product(EVERY, (0, 2), (0,)),
        *product(installed_solvers(), (0, 2), (3,)),  # the pseudo-inverse keeps no inequality rows
    ],
)
def test_points_and_multipliers_have_the_sizes_of_the_qp(
    name: str, me: int, mi: int, solvable
) -> None:
    qp = solvable(np.random.default_rng(3), me=me, mi=mi)
    found = make_backend(name).solve(qp)
    assert found.solved or name == "pseudo_inverse"
    sizes = {"x": 8, "y": me, "z": mi, "z_box": 8}
    assert {key: getattr(found, key).shape for key in sizes} == {k: (n,) for k, n in sizes.items()}
    assert all(np.isfinite(getattr(found, key)).all() for key in sizes)
    assert found.attempts >= 1 and found.solve_time > 0.0


@pytest.mark.parametrize("name", EVERY)
def test_what_is_no_qp_is_refused_by_every_backend(name: str) -> None:
    backend = make_backend(name)
    n = 2
    good = QP.build(np.eye(n), np.ones(n), lower=[-1.0, -1.0], upper=[1.0, 1.0])
    for field, value in (("g", [np.nan, 0.0]), ("P", [[np.inf, 0.0], [0.0, 1.0]]),
                         ("lower", [2.0, 0.0]), ("upper", [-np.inf, 1.0])):  # fmt: skip
        fields = {key: getattr(good, key) for key in good._fields} | {field: np.array(value)}
        with pytest.raises(InvalidInputError):
            backend.solve(QP(**fields))


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


def test_daqp_kept_from_qp_to_qp_finds_what_it_finds_anew(ticks, solvable) -> None:
    """In ticks one after the other, of other sizes in between, and one without solution."""
    kept, answers = KeptDaqp(1e-8), 0
    box = {"lower": -np.ones(35), "upper": np.ones(35)}
    rows = {"A": np.zeros((12, 35)), "b": np.zeros(12), "C": np.ones((3, 35))}
    no_way = QP.build(np.eye(35), np.ones(35), l=[90.0] * 3, u=[95.0] * 3, **rows, **box)
    sequence = [*ticks(1, 4, mi=3), *ticks(2, 3, mi=2), solvable(np.random.default_rng(1)),
                *ticks(3, 2, mi=3), no_way]  # fmt: skip
    for qp in sequence:
        found, expected = kept.answer(qp), Daqp().solve(qp, quick=True)
        assert (found.claim is Status.SOLVED) == expected.solved == (qp is not no_way)
        if qp is no_way:
            assert found.claim is Status.INFEASIBLE
            continue
        np.testing.assert_allclose(found.x, expected.x, atol=1e-6)
        gradient = qp.P @ found.x + qp.g + found.y @ qp.A + found.z @ qp.C + found.z_box
        np.testing.assert_allclose(gradient, 0.0, atol=1e-5 * np.abs(qp.g).max())
        answers += 1
    assert answers == len(sequence) - 1


@pytest.mark.parametrize("sizes", [{}, {"me": 0}, {"n": 35, "me": 12, "mi": 10}])
def test_daqp_kept_is_misled_by_no_qp_before(sizes: dict[str, int], solvable) -> None:
    """Unlike QPs of one size, some without solution; oracle: the KKT conditions, by hand."""
    rng, kept, solved = np.random.default_rng(7), KeptDaqp(1e-8), 0
    for k in range(30):
        qp = solvable(rng, **sizes)
        if k % 5 == 4:  # its first row and its opposite
            rows = np.concatenate((qp.C[:1], -qp.C[:1], qp.C[2:]))
            least = np.concatenate(([1.0, 1.0], qp.l[2:]))
            qp = qp._replace(C=rows, l=least, u=np.concatenate(([2.0, 2.0], qp.u[2:])))
        found = kept.answer(qp)
        if k % 5 == 4:
            assert found.claim is Status.INFEASIBLE
            continue
        assert found.claim is Status.SOLVED
        values = np.concatenate((found.x, qp.C @ found.x))
        lower, upper = np.concatenate((qp.lower, qp.l)), np.concatenate((qp.upper, qp.u))
        pull = np.concatenate((found.z_box, found.z))
        scale = 1.0 + np.abs(qp.g).max() + np.abs(qp.P @ found.x).max()
        gradient = qp.P @ found.x + qp.g + found.y @ qp.A + found.z @ qp.C + found.z_box
        np.testing.assert_allclose(gradient, 0.0, atol=1e-7 * scale)
        np.testing.assert_allclose(qp.A @ found.x, qp.b, atol=1e-7)
        assert (values > lower - 1e-7).all() and (values < upper + 1e-7).all()
        assert (pull[values < upper - 1e-6] <= 1e-7 * scale).all()
        assert (pull[values > lower + 1e-6] >= -1e-7 * scale).all()
        solved += 1
    assert solved == 24


def test_without_rows_the_least_violation_is_none_near_zero() -> None:
    qp = QP.build(np.eye(3), np.ones(3), lower=[-1.0, 0.5, -9.0], upper=[1.0, 2.0, -0.5])
    x, violation = least_violation(qp)
    np.testing.assert_array_equal(x, [0.0, 0.5, -0.5])
    assert violation.size == 0


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
    one = Solution(np.zeros(3), none, none, none, Status.FAILED, residuals, 7, 0.1, "daqp")
    assert one.describe() == (
        "daqp: failed after 7 iterations in attempt 1 (primal residual 1.0e-09, dual 2.0e-08,"
        " complementarity 3.0e-07)"
    )
    assert not one.solved
    assert repr(one) == "Solution(failed by daqp, 3 variables, 7 iterations)"
    qp = QP.build(np.eye(2), np.ones(2), C=np.ones((1, 2)), u=[1.0], A=np.ones((1, 2)), b=[0.0])
    assert repr(qp) == "QP(2 variables, 1 equalities, 1 inequalities)"
    raw = RawSolution.none(qp, Status.INFEASIBLE, "no way")
    assert [len(part) for part in (raw.x, raw.y, raw.z, raw.z_box)] == [2, 1, 1, 2]
    assert np.isnan(raw.x).all() and np.isnan(raw.z).all() and raw.iterations == 0
    assert Labels.numbered(2, 1, 1).variables == ("x0", "x1")
    assert Labels.numbered(2) == Labels((), (), ("x0", "x1"))


# daqp/include/constants.h: what each exit flag is called there.
FLAGS = {1: "solved", 2: "soft", -1: "infeasible", -2: "cycle", -3: "unbounded", -4: "limit",
         -5: "nonconvex", -6: "overdetermined", -7: "none that is known"}  # fmt: skip


@pytest.mark.parametrize("flag", FLAGS)
def test_exit_flags_of_daqp_in_our_words(flag: int, solvable) -> None:
    qp = solvable(np.random.default_rng(2), me=2, mi=3)
    point, multipliers = np.arange(8.0), np.arange(13.0)
    found = _raw(qp, point, multipliers, 7, flag)
    claims = {"solved": Status.SOLVED, "infeasible": Status.INFEASIBLE,
              "overdetermined": Status.INFEASIBLE, "limit": Status.ITERATION_LIMIT}  # fmt: skip
    words = {"solved": "", "soft": "exit flag 2", "infeasible": "infeasible", "cycle": "cycles",
             "unbounded": "unbounded", "limit": "iteration limit", "nonconvex": "semidefinite",
             "overdetermined": "contradict", "none that is known": "exit flag -7"}  # fmt: skip
    assert (
        found.claim is claims.get(FLAGS[flag], Status.FAILED)
        and words[FLAGS[flag]] in found.message
    )
    assert found.iterations == 7
    parts = (found.z_box, found.z, found.y)
    np.testing.assert_array_equal(np.concatenate(parts), multipliers)
    assert [part.size for part in parts] == [8, 3, 2]
    for endless in (np.inf, np.nan, -1e100):  # as it leaves them on QPs without solution
        left = _raw(qp, point, np.append(multipliers[:-1], endless), 7, flag)
        claimed = Status.FAILED if FLAGS[flag] == "solved" else found.claim
        assert np.isnan(left.x).all() and left.claim is claimed
    assert np.isnan(_raw(qp, np.append(point[:-1], np.nan), multipliers, 7, flag).y).all()


def test_daqp_kept_says_what_it_does_not_take_and_goes_on() -> None:
    """A cost that is no bowl is refused before anything is solved; so are too few iterations."""
    box = {"lower": -np.ones(3), "upper": np.ones(3)}
    qp = QP.build(np.eye(3), [3.0, -2.0, 1.0], C=np.ones((1, 3)), l=[-9.0], u=[9.0], **box)
    kept = KeptDaqp(1e-8)
    for _ in range(2):  # a new model, and the one that is kept
        refused = kept.answer(qp._replace(P=-qp.P))
        assert refused.claim is Status.FAILED and "positive semidefinite" in refused.message
        assert np.isnan(refused.x).all()
        np.testing.assert_allclose(kept.answer(qp).x, [-1.0, 1.0, -1.0], atol=1e-9)
    limited = KeptDaqp(1e-8, max_iterations=1).answer(qp)
    assert limited.claim is Status.ITERATION_LIMIT
