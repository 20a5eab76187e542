"""QPs with rows that give way, and the closest command: against solvers with slacks, and HiGHS."""

from pathlib import Path

import numpy as np
import pytest
import qpsolvers
from conflict_judge import can_hold, conflict_error

from wbc.controllers.first_level import FirstLevel
from wbc.controllers.slack import SlackQP
from wbc.errors import InvalidInputError
from wbc.qp.active_set import ActiveSet
from wbc.qp.backend import make_backend
from wbc.qp.core import DONE, solve_in_core
from wbc.qp.kkt import kkt_residuals
from wbc.qp.least_infeasible import least_infeasible
from wbc.qp.problem import QP, Labels
from wbc.qp.proxqp import ProxQP
from wbc.qp.solution import Solution, Status

UNSOLVED = -1  # of native/source/core.h


def giving_qp(rng: np.random.Generator, n: int, me: int, mi: int, soft: float) -> SlackQP:
    """A QP whose hard rows leave room about a point, which rows that give way do not."""
    J = rng.normal(size=(n + 3, n)) * 10.0 ** rng.uniform(-1, 1, size=(n + 3, 1))
    inside = rng.normal(size=n)
    A, C = rng.normal(size=(me, n)), rng.normal(size=(mi, n))
    gives = rng.random(mi) < soft
    shift = np.where(gives, 2.0 * rng.normal(size=mi), 0.0)
    values = C @ inside + shift
    weights = np.where(gives, 10.0 ** rng.uniform(-1, 4, size=mi), np.inf)
    one_sided = rng.random(mi) < 0.5
    qp = QP.build(
        J.T @ J + 1e-3 * np.eye(n), -J.T @ (3.0 * rng.normal(size=n + 3)), A=A, b=A @ inside, C=C,
        l=np.where(one_sided, -np.inf, values - rng.random(mi)), u=values + rng.random(mi),
        lower=np.where(rng.random(n) < 0.5, inside - rng.random(n), -np.inf),
        upper=np.where(rng.random(n) < 0.5, inside + rng.random(n), np.inf),
    )  # fmt: skip
    return SlackQP(qp, weights)


def assert_solved_as_by_proxqp(given: SlackQP, atol: float) -> Solution:
    """The answer, which meets the QP with slacks and is where ProxQP's is."""
    full, found = given.qp, ActiveSet().solve_soft(*given)
    assert found.solved
    assert max(kkt_residuals(full, found.x, found.y, found.z, found.z_box)) <= 1e-8
    other = ProxQP().solve(full)
    assert other.solved
    np.testing.assert_allclose(found.x, other.x, atol=atol)
    return found


@pytest.mark.parametrize("seed", range(40))
def test_the_answer_is_that_of_the_qp_with_slacks(seed: int) -> None:
    """x, slacks and every multiplier, with rows that are active and rows that gave way."""
    rng = np.random.default_rng(seed)
    sizes = int(rng.integers(3, 30)), int(rng.integers(0, 3)), int(rng.integers(1, 60))
    given = giving_qp(rng, *sizes, soft=rng.random())
    full, found = given.qp, ActiveSet().solve_soft(*given)
    assert found.status is Status.SOLVED
    assert found.x.size == full.g.size and found.solver == "active_set"
    told = kkt_residuals(full, found.x, found.y, found.z, found.z_box)
    assert max(told) <= 1e-8 and np.abs(np.subtract(told, found.residuals)).max() < 1e-10
    for cold in (make_backend("daqp"), ProxQP(warm=False, always=True)):
        if (other := cold.solve(full)).solved and other.solver != "active_set":
            break
    assert other.solved and other.solver != "active_set"
    np.testing.assert_allclose(found.x, other.x, atol=1e-6)
    np.testing.assert_allclose(found.z, other.z, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("seed", range(10))
def test_the_answer_does_not_depend_on_the_unit_of_the_cost(seed: int) -> None:
    """As of a heavy task: residuals in the cost's large numbers were taken for no answer."""
    rng = np.random.default_rng(seed)
    qp, weights = giving_qp(rng, 20, 2, 40, soft=0.5)
    heavy = ActiveSet().solve_soft(qp._replace(P=1e9 * qp.P, g=1e9 * qp.g), 1e9 * weights)
    assert heavy.solved
    np.testing.assert_allclose(heavy.x, ActiveSet().solve_soft(qp, weights).x, atol=1e-7)


def test_rows_give_way_by_their_weights() -> None:
    """Two rows that contradict each other share by their weights; a hard one does not."""
    C, u = np.array([[1.0], [-1.0]]), np.array([-1.0, -1.0])  # x <= -1, x >= 1
    qp = QP.build([[1e-6]], [0.0], C=C, u=u)
    found = ActiveSet().solve_soft(qp, np.array([1.0, 3.0]))
    assert found.solved
    np.testing.assert_allclose(found.x, [0.5, 1.5, 0.5], atol=1e-5)
    hard = ActiveSet().solve_soft(qp, np.array([np.inf, 3.0]))
    assert hard.solved
    np.testing.assert_allclose(hard.x, [-1.0, 2.0], atol=1e-5)


def test_the_cost_need_not_be_strictly_convex() -> None:
    """As beside heavy tasks, whose rounding hides the damping: no answer was found."""
    qp = QP.build(np.diag([1.0, 0.0]), [0.0, 0.0], C=[[1.0, 0.0], [1.0, 1.0]], l=[2.0, 3.0])
    found = ActiveSet().solve_soft(qp, np.array([3.0, np.inf]))
    assert found.solved
    np.testing.assert_allclose(found.x[[0, 2]], [1.5, -0.5], atol=1e-6)
    assert found.x[0] + found.x[1] >= 3.0 - 1e-6


def test_hard_rows_that_contradict_each_other_have_no_answer() -> None:
    """Which contradict each other is said; nothing is where there are too few iterations."""
    hard = np.full(2, np.inf)
    qp = QP.build([[1.0]], [0.0], C=[[1.0], [-1.0], [1.0]], u=[-1.0, -1.0, -2.0])
    none = ActiveSet().solve_soft(qp, np.array([np.inf, np.inf, 2.0]))
    assert none.status is Status.INFEASIBLE and none.conflict is not None
    assert {row.label for row in none.conflict.rows} == {"inequality 0", "inequality 1"}
    qp = QP.build(np.eye(2), [-3.0, -3.0], C=np.eye(2), u=[1.0, 1.0])
    few = ActiveSet(max_iterations=1).solve_soft(qp, hard)
    assert few.status is Status.FAILED and few.conflict is None and np.isnan(few.x).all()
    with pytest.raises(InvalidInputError, match=r"QP\.g"):
        ActiveSet().solve_soft(qp._replace(g=np.array([np.nan, 0.0])), hard)


@pytest.mark.parametrize("seed", range(20))
def test_only_rows_that_may_not_give_way_are_in_conflict(seed: int) -> None:
    """Hard rows contradict each other, soft ones each other and the hard ones: HiGHS agrees."""
    rng = np.random.default_rng(seed)
    given = giving_qp(rng, n := int(rng.integers(3, 20)), 1, 12, soft=0.5)
    qp, weights = given.slackless, given.weights
    row = rng.normal(size=n)
    C = np.concatenate((qp.C, [row, -row]))
    end = np.full(2, 0.5 - row @ rng.normal(size=n))
    both = np.concatenate((qp.u, [-end[0], end[0] - rng.uniform(0.1, 1.0)]))
    qp = QP.build(qp.P, qp.g, A=qp.A, b=qp.b, C=C, l=np.append(qp.l, [-np.inf] * 2), u=both,
                  lower=qp.lower, upper=qp.upper)  # fmt: skip
    found = ActiveSet().solve_soft(qp, np.append(weights, [np.inf] * 2))
    assert found.status is Status.INFEASIBLE and found.conflict is not None
    soft = {qp.labels.inequality[k] for k in np.flatnonzero(np.isfinite(weights))}
    assert not soft & {one.label for one in found.conflict.rows}
    assert conflict_error(qp, found.conflict) == []


@pytest.mark.parametrize("seed", range(20))
def test_corners_of_many_rows(seed: int) -> None:
    """Cones meet in one point, where more facets than unknowns are active, and some depend."""
    rng = np.random.default_rng(seed)
    feet, mu = 4, 0.6
    n = 3 * feet
    facets = np.array([[1, 0, -mu], [-1, 0, -mu], [0, 1, -mu], [0, -1, -mu], [1, 1, -2 * mu]])
    cone = np.kron(np.eye(feet), facets)
    J = rng.normal(size=(4, n))
    soft = rng.normal(size=(6, n))
    C = np.concatenate((cone, soft))
    pull = np.tile([0.0, 0.0, 1.0], feet) + 0.1 * rng.normal(size=n)  # against the cones
    lower, u = np.full(len(C), -np.inf), np.zeros(len(C))
    u[len(cone) :] = -1.0
    weights = np.r_[np.full(len(cone), np.inf), 10.0 ** rng.uniform(0, 3, size=6)]
    qp = QP.build(J.T @ J + 1e-4 * np.eye(n), pull, C=C, l=lower, u=u)
    assert_solved_as_by_proxqp(SlackQP(qp, weights), atol=1e-5)


def test_slacks_that_hardly_count() -> None:
    """A row that gives way by next to nothing, and depends on hard ones."""
    C = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    qp = QP.build(np.eye(2), [0.0, 0.0], C=C, l=[1.0, 1.0, -np.inf], u=[np.inf, np.inf, 1.5])
    found = ActiveSet().solve_soft(qp, np.array([np.inf, np.inf, 1e7]))
    assert found.solved
    np.testing.assert_allclose(found.x, [1.0, 1.0, 0.5], atol=1e-7)


@pytest.mark.parametrize(("off", "solved"), [(2e-6, True), (5e-5, False)])
def test_what_is_nearly_solved_is_taken_where_nobody_else_is_near(off, solved, monkeypatch) -> None:
    """Up to a thousand times eps, by the residuals alone: without it a robot is only damped."""
    qp = QP.build(np.eye(2), [0.0, 0.0], C=np.eye(2), l=[1.0, -np.inf], u=[np.inf, -1.0])
    weights = np.array([np.inf, 4.0])

    def rough(qp: QP, eps: float, most: int, give=None):
        """The core's answer with x off its hard row, and what the core would say of that."""
        found = solve_in_core(qp, eps, most, give)
        residuals = found.residuals._replace(primal=off)
        status = DONE if off <= eps else UNSOLVED
        return found._replace(x=found.x - [off, 0.0], residuals=residuals, status=status)

    monkeypatch.setattr("wbc.qp.active_set.solve_in_core", rough)
    found = FirstLevel(ActiveSet(), torque=True).solve_relaxed(qp, weights, np.zeros(qp.g.size))
    assert found.solved is solved
    if solved:
        assert found.residuals.primal == off


def test_many_rows_that_are_missed_at_once() -> None:
    """Hundreds of limits beyond which everything is, as of a robot in a wild state: few steps."""
    rng = np.random.default_rng(3)
    n, m = 60, 400
    J, C = rng.normal(size=(n, n)), rng.normal(size=(m, n))
    C[rng.random((m, n)) < 0.8] = 0.0
    C[:n] = np.eye(n)
    u = C @ rng.normal(size=n) - 3.0 * rng.random(m)
    weights = np.where(np.arange(m) < 20, np.inf, 10.0 ** rng.uniform(0, 4, size=m))
    qp = QP.build(J.T @ J + 1e-3 * np.eye(n), 30.0 * rng.normal(size=n), C=C, u=u)
    found = assert_solved_as_by_proxqp(SlackQP(qp, weights), atol=1e-6)
    assert np.count_nonzero(found.z) > n
    assert found.iterations < 600  # 770 when rows came one at a time; 367


def test_what_is_nearly_solved_will_do() -> None:
    """A TALOS fell over its own feet: a cone was missed by 3e-6 of mass / dt, 0.1 N.

    With the slacks as unknowns 250 ms were tried, and in the end no answer was commanded.
    """
    with np.load(Path(__file__).parent / "nearly_solved.npz") as recorded:
        weights = recorded["weights"]
        names = ("P", "g", "A", "b", "C", "l", "u", "lower", "upper")
        qp = QP.build(**{name: recorded[name] for name in names})
    given = SlackQP(qp, weights)
    found = FirstLevel(ActiveSet(), torque=True).solve_relaxed(qp, weights, np.zeros(qp.g.size))
    assert found.solved and found.solver == "active_set"
    told = kkt_residuals(given.qp, found.x, found.y, found.z, found.z_box)
    assert max(told) <= 1e-5


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
