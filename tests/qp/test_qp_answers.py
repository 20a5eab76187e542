"""Answers of every backend: shapes, finite numbers, refusals, counts of attempts, and words."""

from itertools import product

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.qp import QP, installed_solvers, make_backend
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
