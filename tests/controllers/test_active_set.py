"""Bounds that a level leaves no choice about, against linear programs over all that it achieves."""

import numpy as np
import pytest
from scipy.optimize import linprog

from wbc.controllers.active_set import ActiveSet, _positive_kernel, achieved_rows
from wbc.controllers.plan import Decision
from wbc.laws import Rows
from wbc.qp import QP
from wbc.qp.active_set import ActiveSet as CoreSolver

N = 6


def level(rng: np.random.Generator, tasks: int) -> tuple[QP, Rows]:
    """Return the damped QP of a level with a far target, an equality row, a box and two rows."""
    J, A, C = rng.normal(size=(tasks, N)), rng.normal(size=(1, N)), rng.normal(size=(2, N))
    rows = Rows(J, 20.0 * rng.normal(size=tasks), np.ones(tasks))
    P = J.T @ J + 1e-6 * np.eye(N)
    return QP.build(P, -rows.target @ J, A=A, b=np.zeros(1), C=C, u=np.full(2, 0.3),
                    lower=-np.ones(N), upper=np.ones(N)), rows  # fmt: skip


def implied(qp: QP, rows: Rows, x: np.ndarray) -> np.ndarray:
    """Return which of the variables and rows have one value only, by two linear programs each."""
    equal = np.concatenate((qp.A, rows.matrix))
    values = []
    for row in np.concatenate((np.eye(N), qp.C)):
        ends = []
        for sign in (1.0, -1.0):
            found = linprog(
                sign * row,
                qp.C,
                np.maximum(qp.u, qp.C @ x),
                equal,
                equal @ x,
                np.column_stack((np.minimum(qp.lower, x), np.maximum(qp.upper, x))),
            )
            assert found.status == 0
            ends.append(sign * found.fun)
        values.append(ends[1] - ends[0] < 1e-6)
    return np.array(values)


@pytest.mark.parametrize("tasks", [1, 2, 3, 4])
def test_bounds_are_kept_where_there_is_no_choice_left(tasks: int) -> None:
    rng, kept = np.random.default_rng(8 + tasks), 0
    for _ in range(12):
        qp, rows = level(rng, tasks)
        solution = CoreSolver(1e-10).solve(qp)
        assert solution.solved
        x = solution.x
        decision = Decision(qp.labels.variables, N, np.full(N, 1e-6), np.zeros(0), np.zeros(0))
        found = ActiveSet.implied(qp, solution, achieved_rows([rows], x), decision)
        expected = implied(qp, rows, x)
        at_end = np.concatenate((np.abs(np.abs(x) - 1.0), np.abs(qp.C @ x - 0.3))) < 1e-7
        np.testing.assert_array_equal(
            np.concatenate((found.variables, found.rows)), expected & at_end
        )
        kept += np.count_nonzero(expected & at_end)
    assert kept >= 12


def test_what_any_level_left_no_choice_about_stays_so() -> None:
    x, y = np.arange(3.0), np.arange(3.0) + 5.0
    one = ActiveSet(np.array([True, False, False]), np.array([False, True]), x)
    other = ActiveSet(np.array([False, True, False]), np.array([False, False]), y)
    both = one.union(other)
    assert both.variables.tolist() == [True, True, False] and both.rows.tolist() == [False, True]
    assert both.x is x and one.union(None) is one


def test_the_next_level_has_them_as_equalities_and_room_for_what_was_missed(rng) -> None:
    qp = QP.build(np.eye(3), np.ones(3), A=rng.normal(size=(1, 3)), b=[2.0],
                  C=rng.normal(size=(2, 3)), l=[-1.0, -1.0], u=[1.0, 1.0],
                  lower=-np.ones(3), upper=np.ones(3))  # fmt: skip
    x = np.array([1.0, 1.5, -1.25])
    active = ActiveSet(np.array([True, False, False]), np.array([False, True]), x)
    found, values = active.as_equalities(qp), qp.C @ x
    np.testing.assert_array_equal(found.A, np.concatenate((qp.A, [[1.0, 0.0, 0.0]], qp.C[1:])))
    np.testing.assert_allclose(found.b, [qp.A[0] @ x, 1.0, values[1]], rtol=0.0, atol=1e-14)
    assert found.labels.equality == ("equality 0", "x0", "inequality 1")
    np.testing.assert_array_equal(found.lower, [-np.inf, -1.0, -1.25])
    np.testing.assert_array_equal(found.upper, [np.inf, 1.5, 1.0])
    np.testing.assert_array_equal(found.l, [min(-1.0, values[0]), -np.inf])
    np.testing.assert_array_equal(found.u, [max(1.0, values[0]), np.inf])
    assert found.labels.variables == qp.labels.variables


def test_what_has_no_weight_is_not_kept() -> None:
    (held,) = achieved_rows([Rows(np.eye(3, 4), np.ones(3), np.array([1.0, 0.0, 2.0]))],
                            np.array([5.0, 6.0, 7.0, 8.0, 9.0]))  # fmt: skip
    np.testing.assert_array_equal(held.matrix, np.eye(3, 4)[[0, 2]])
    assert held.target.tolist() == [5.0, 7.0] and held.weight.tolist() == [1.0, 1.0]


def test_a_small_multiplier_is_one() -> None:
    """Vectors that cancel with z = (1, 1e-5) both take part; beside them a third has no partner."""
    vectors = np.array([[1.0, 0.0], [-1e5, 0.0], [0.0, 1.0]])
    assert _positive_kernel(vectors, np.array([1.0, 1e-5, 0.5])).tolist() == [0, 1]
    assert _positive_kernel(vectors, np.array([1.0, 1e-5, 0.0])).tolist() == [0, 1]
    assert _positive_kernel(vectors[[0, 2]], np.ones(2)).size == 0
    assert _positive_kernel(np.array([[1.0], [-1e9]]), np.array([1.0, 1e-9])).size == 0  # rounding


@pytest.mark.parametrize(("z", "more"), [(4.1e-5, True), (-4.1e-5, True), (3.9e-5, False)])
def test_what_damping_may_explain_is_not_implied(z: float, more: bool) -> None:
    """Ten times the largest damping of the largest unknown; rows with a slack give way."""
    decision = Decision(("a", "b"), 2, np.array([1e-6, 2e-6]), np.zeros(0), np.zeros(0))
    qp = QP.build(np.eye(3), np.zeros(3), C=[[1.0, 0.0, 0.0], [1.0, 0.0, -1.0]],
                  l=[-1.0, -1.0], u=[1.0, 1.0], lower=-np.ones(3), upper=np.ones(3))  # fmt: skip
    solved = CoreSolver().solve(qp)
    solution = solved._replace(
        x=np.array([0.5, -2.0, 30.0]), z=np.array([z, 1.0]), z_box=np.array([z, 0.0, 1.0])
    )
    achieved = [Rows(np.array([[3.0, 0.0]]), np.array([1.5]), np.ones(1))]
    found = ActiveSet.implied(qp, solution, achieved, decision)
    assert found.variables.tolist() == [more, False, False]
    assert found.rows.tolist() == [more, False]
