"""ProxQP over sequences of ticks: warm starts help, do not leak, and do not poison."""

import numpy as np
import pytest
from conflict_judge import conflict_error

from tests.qp.conftest import recorded
from wbc.controllers.first_level import FirstLevel
from wbc.qp import QP, ProxQP, Status, make_backend
from wbc.qp.active_set import NO_RESIDUALS, ActiveSet
from wbc.qp.proxqp_workspace import Workspace
from wbc.qp.solution import RawSolution, Solution


@pytest.mark.parametrize(("mi", "speed"), [(0, 1.0), (25, 1.0), (0, 100.0), (25, 100.0)])
def test_every_tick_is_the_optimum(ticks, mi, speed):
    """Warm ProxQP says "solved" with the wrong active set now and then; the policy must not."""
    backend, oracle = ProxQP(), ActiveSet()
    for qp in ticks(seed=7, count=60, mi=mi, speed=speed):
        solution, exact = backend.solve(qp), oracle.solve(qp)
        assert solution.solved, solution.describe()
        # eps = 1e-8 relative to the largest term, which is below 10 here.
        assert max(solution.residuals.primal, solution.residuals.dual) <= 1e-7
        # P's smallest eigenvalue is 1e-4: residuals of 1e-9 leave at most 1e-5 in the point.
        np.testing.assert_allclose(solution.x, exact.x, atol=1e-5)


def test_warm_start_saves_iterations(ticks):
    warm, cold = ProxQP(), ProxQP(warm=False)
    counts = [
        (warm.solve(qp).iterations, cold.solve(qp).iterations) for qp in ticks(seed=7, count=40)
    ]
    later = np.array(counts[1:]).sum(axis=0)
    assert counts[0][0] == counts[0][1]
    assert 2 * later[0] < later[1]


def test_two_contact_sets_do_not_share_a_warm_start(ticks):
    """Interleaved with another contact set of the same sizes: as if alone."""
    alone, shared = ProxQP(), ProxQP()
    for qp, other in zip(ticks(seed=1, count=15), ticks(seed=2, count=15), strict=True):
        expected = alone.solve(qp, workspace=("left", "right"))
        shared.solve(other, workspace=("left",))
        found = shared.solve(qp, workspace=("left", "right"))
        assert found.iterations == expected.iterations
        np.testing.assert_array_equal(found.x, expected.x)


def test_the_same_tick_twice(ticks):
    """ProxQP 0.8 scales the box twice when solved twice without an update in between."""
    backend = ProxQP()
    (qp,) = ticks(seed=4, count=1)
    first = backend.solve(qp)
    for _ in range(5):
        again = backend.solve(qp)
        assert again.solved
        assert again.attempts == 1
        np.testing.assert_allclose(again.x, first.x, atol=1e-6)


def test_a_rejected_warm_answer_is_solved_again_cold(ticks, monkeypatch):
    first, second, third = ticks(seed=4, count=3)
    backend = ProxQP()
    backend.solve(first)
    honest = Workspace.solve_warm

    def wrong(self, qp):
        answer = honest(self, qp)
        return answer._replace(z_box=answer.z_box + 1e-3)

    monkeypatch.setattr(Workspace, "solve_warm", wrong)
    solution = backend.solve(second)
    assert solution.solved
    assert solution.attempts == 2
    monkeypatch.undo()
    assert backend.solve(third).attempts == 1


def test_cold_answers_are_right_the_first_time(solvable):
    """The settings carry this, not the policy: without the duality-gap test about 2 % are wrong."""
    rng, backend = np.random.default_rng(2024), ProxQP(warm=False)
    retried = 0
    for _ in range(400):
        n = int(rng.integers(2, 20))
        qp = solvable(rng, n=n, me=int(rng.integers(0, n // 2 + 1)), mi=int(rng.integers(0, 9)))
        retried += backend.solve(qp).attempts > 1
    assert retried <= 1


def _no_active_set(monkeypatch):
    """It finds nothing."""

    def nothing(self, qp, workspace="default", quick=False):
        none = RawSolution.none(qp, Status.FAILED, "nothing")
        return Solution(*none[:4], Status.FAILED, NO_RESIDUALS, 0, 0.0, "active_set")

    monkeypatch.setattr(ActiveSet, "solve", nothing)


def test_nan_from_the_solver_never_leaves_as_solved(ticks, monkeypatch):
    _no_active_set(monkeypatch)
    first, second = ticks(seed=4, count=2)
    backend = ProxQP()
    backend.solve(first)
    for method in ("solve_warm", "solve_cold"):
        honest = getattr(Workspace, method)

        def broken(self, *qp, honest=honest):
            answer = honest(self, *qp)
            return answer._replace(x=np.full_like(answer.x, np.nan))

        monkeypatch.setattr(Workspace, method, broken)
    solution = backend.solve(second)
    assert solution.status is Status.FAILED
    assert not solution.solved
    assert solution.attempts == 2  # warm, by active set


def test_where_it_stalls_the_active_set_method_comes_first(ticks, monkeypatch):
    """What stalls once would stall in every tick: ProxQP is not asked, unless that fails."""
    qps = list(ticks(seed=4, count=4, mi=25))
    expected = {qp.g.tobytes(): ProxQP().solve(qp).x for qp in qps}
    backend = ProxQP(max_iterations=1)
    assert backend.solve(qps[0]).attempts == 2
    solves = []
    honest = Workspace.solve_cold
    monkeypatch.setattr(Workspace, "solve_cold", lambda self: solves.append(1) or honest(self))
    for qp in qps[1:3]:
        assert backend.solve(qp).solver == "active_set"
        np.testing.assert_allclose(backend.solve(qp).x, expected[qp.g.tobytes()], atol=1e-6)
    assert not solves
    assert backend.solve(qps[1], workspace="another").solved
    assert solves  # another name has not stalled
    solves.clear()
    _no_active_set(monkeypatch)
    backend.solve(qps[3])
    assert solves


def test_a_cost_over_many_decades_is_solved():
    """A tick of the soak, curvatures 1e-6 to 1e10: ProxQP alone took 30 ms and gave up."""
    qp = recorded("stalls_proxqp")
    alone = Workspace.create(qp, eps=1e-8, max_iterations=50).solve_cold()
    assert alone.claim is Status.ITERATION_LIMIT
    solution = ProxQP().solve(qp)
    assert solution.solved and solution.solver == "active_set"


@pytest.mark.parametrize("k", range(4))
@pytest.mark.parametrize("name", ["active_set", "proxqp", "proxqp once"])
def test_curvatures_far_apart_are_no_contradiction(name: str, k: int) -> None:
    """Ticks of the soak, curvatures 1e-6 to 1e13: others said infeasible, or took 300 iterations.

    That they are feasible and solved is seen by their residuals, relative to their own terms.
    """
    qp = recorded(f"curvatures_far_apart {k}")
    if name == "proxqp once":
        solution = ProxQP().solve(qp, workspace=None)
        assert solution.solver == "active_set" and solution.attempts == 1
    else:
        solution = make_backend(name).solve(qp)
    assert solution.solved, solution.describe()
    x, y, z, z_box = solution.x, solution.y, solution.z, solution.z_box
    assert max(np.abs(qp.A @ x - qp.b).max(), (x - qp.upper).max(), (qp.lower - x).max()) < 1e-9
    if qp.u.size:
        assert max((qp.C @ x - qp.u).max(), (qp.l - qp.C @ x).max()) < 1e-9
    terms = (qp.P @ x, qp.g, y @ qp.A, z @ qp.C, z_box)
    assert np.abs(sum(terms)).max() < 1e-8 * max(np.abs(term).max() for term in terms)


@pytest.mark.parametrize("k", range(4))
def test_the_last_who_is_asked_looks_twice(k: int) -> None:
    """Such a relaxed QP was not solved in one attempt, and the tick was damped.

    A TALOS that leant with its CoM 40 mm beyond its toes was, 14 ticks in a row, and fell sooner.
    """
    qp = recorded(f"curvatures_far_apart {k}")
    assert FirstLevel(ActiveSet(), torque=True).solve_relaxed(qp, None, np.zeros(qp.g.size)).solved


def test_what_will_not_come_again_leaves_no_warm_start(ticks, monkeypatch) -> None:
    """Another is asked first; where that finds nothing ProxQP is asked, from nothing."""
    backend, (qp,) = ProxQP(), ticks(seed=4, count=1)
    assert backend.solve(qp, workspace=None).solver == "active_set"
    _no_active_set(monkeypatch)
    for _ in range(2):
        found = backend.solve(qp, workspace=None)
        assert found.solved and found.solver == "proxqp"
        assert not backend._workspaces


def test_iteration_limit_is_reported_and_forgotten(ticks, monkeypatch):
    _no_active_set(monkeypatch)
    first, second = ticks(seed=4, count=2)
    backend = ProxQP(max_iterations=1)
    solution = backend.solve(first)
    assert solution.status is Status.ITERATION_LIMIT
    assert solution.conflict is None
    assert "MAX_ITER" in solution.describe()
    again, fresh = backend.solve(second), ProxQP(max_iterations=1).solve(second)
    assert again.attempts == fresh.attempts, "the failed tick left a workspace behind"
    assert again.iterations == fresh.iterations


def test_an_infeasible_tick_does_not_poison_the_next(ticks):
    backend = ProxQP()
    good, between, after = ticks(seed=4, count=3)
    assert backend.solve(good).solved
    assert backend.solve(between._replace(b=between.b + 100.0)).status is Status.INFEASIBLE
    recovered = backend.solve(after)
    assert recovered.solved
    np.testing.assert_allclose(recovered.x, ProxQP().solve(after).x, atol=1e-6)


def test_what_is_infeasible_again_is_refuted_without_proxqp(ticks, monkeypatch):
    """The active-set method says so at once; the certificate is checked all the same."""
    backend, sizes = ProxQP(), []
    good, *bad = (
        qp._replace(b=qp.b + 100.0 * (k > 0)) for k, qp in enumerate(ticks(seed=4, count=4))
    )
    honest = Workspace.solve_cold
    monkeypatch.setattr(
        Workspace, "solve_cold", lambda self: sizes.append(self.native.model.dim) or honest(self)
    )
    for qp in bad:
        solution = backend.solve(qp)
        assert solution.status is Status.INFEASIBLE
        assert conflict_error(qp, solution.conflict) == []
    assert sizes.count(good.g.size) == 1  # the first time; others are of the search for rows
    assert backend.solve(good).solved


@pytest.mark.parametrize("scale", [1e-3, 1e3, 1e6])
def test_costs_in_other_units(ticks, scale):
    backend, plain = ProxQP(), ProxQP()
    for qp in ticks(seed=9, count=20):
        scaled = qp._replace(P=scale * qp.P, g=scale * qp.g)
        solution = backend.solve(scaled)
        assert solution.solved, solution.describe()
        assert solution.iterations < 100, "rounding keeps the solver busy"
        # With costs times 1e-3 the residual of 1e-9 weighs a thousand times more in the point.
        np.testing.assert_allclose(solution.x, plain.solve(qp).x, atol=1e-3 if scale < 1 else 1e-5)


def test_unbounded_objective_is_a_failure_not_an_answer():
    qp = QP.build(np.diag([1.0, 0.0]), [0.0, -1.0])
    solution = ProxQP().solve(qp)
    assert not solution.solved
    assert solution.status in (Status.FAILED, Status.ITERATION_LIMIT)
    assert solution.conflict is None


def test_what_the_active_set_method_settles_in_a_pause_took_one_attempt(ticks) -> None:
    """Solved, or with rows that contradict each other: ProxQP has no turn."""
    first, second = ticks(seed=4, count=2, mi=3)
    no_way = second._replace(C=np.repeat(second.C[:1], 3, axis=0), l=np.array([-1.0, -1.0, 5.0]),
                     u=np.array([0.0, 9.0, 6.0]))  # fmt: skip
    backend = ProxQP(max_iterations=1)
    assert [backend.solve(qp).attempts for qp in (first, second, second)] == [2, 1, 1]
    found = backend.solve(no_way)
    assert (found.status, found.solver, found.attempts) == (Status.INFEASIBLE, "active_set", 1)
    assert found.conflict is not None and {row.label for row in found.conflict.rows} == {
        "inequality 0", "inequality 2"}  # fmt: skip
