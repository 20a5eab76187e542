"""What a call of a solver may take is bounded by the work that is left: by counting, never by time.

QPs are those that were recorded because solvers stall or err on them, and generated ones.
"""

import numpy as np
import pytest

from tests.needs import needs_core, needs_direct_daqp
from tests.qp.conftest import recorded
from wbc.qp import QP, ProxQP, Status, find_conflict, make_backend
from wbc.qp.daqp import Daqp
from wbc.qp.daqp_memory import DaqpMemory
from wbc.qp.least_infeasible import least_infeasible
from wbc.qp.native import Workspace
from wbc.qp.native_daqp import NativeDaqp
from wbc.qp.work import ACTIVE_SET, COLD, INNER, WARM, Work, search

RECORDED = ("stalls_proxqp", "curvatures_far_apart 0", "curvatures_far_apart 2", "false_infeasible")
BUDGETS = (1.0, 300.0, 700.0, 1500.0, 2800.0)


def infeasible() -> QP:
    """Return a QP of a humanoid's size in which an equality contradicts a bound."""
    rng = np.random.default_rng(3)
    n, A = 35, np.zeros((6, 35))
    A[:, :12] = rng.normal(size=(6, 12))
    A[0] = 0.0
    A[0, 0] = 1.0
    J = rng.normal(size=(40, n))
    upper = np.ones(n)
    return QP.build(J.T @ J, J.T @ rng.normal(size=40), A=A, b=[2.0, 0, 0, 0, 0, 0], upper=upper)


@pytest.fixture
def counted(monkeypatch):
    """Return what solvers took, in units: by the iterations that they report themselves."""
    units: list[float] = []
    solve = DaqpMemory.solve
    cold, warm = Workspace.solve_cold, Workspace.solve_warm

    def by_daqp(self, most):
        found = solve(self, most)
        assert found.iterations <= most
        units.append(ACTIVE_SET.step(self.stacked.x.size) * found.iterations)
        return found

    def by_proxqp(self, qp=None):
        found = cold(self) if qp is None else warm(self, qp)
        steps = self.native.results.info
        assert steps.iter <= INNER * max(steps.iter_ext, 1)
        units.append(COLD.step(found.x.size) * steps.iter)
        return found

    monkeypatch.setattr(DaqpMemory, "solve", by_daqp)
    monkeypatch.setattr(Workspace, "solve_cold", by_proxqp)
    monkeypatch.setattr(Workspace, "solve_warm", by_proxqp)
    return units


@pytest.mark.parametrize("name", RECORDED)
@pytest.mark.parametrize("solver", ["proxqp", "proxqp_cold", "daqp"])
@pytest.mark.parametrize("quick", [False, True])
def test_iterations_and_attempts_keep_the_budget(name, solver, quick, counted) -> None:
    """However many attempts there are; and what is said to be solved is so, to the same point."""
    qp = recorded(name)
    true = make_backend(solver).solve(qp)
    for budget in BUDGETS:
        counted.clear()
        work = Work(budget)
        found = make_backend(solver).solve(qp, quick=quick, work=work)
        assert sum(counted) <= budget
        # Whatever a step needs to be set up, and a search that began before it was known how long.
        assert work.spent <= budget + ACTIVE_SET.units(qp) + COLD.units(qp) + search(qp)
        assert found.status is not Status.INFEASIBLE  # they have solutions
        if found.solved and true.solved:
            cost = [0.5 * one.x @ qp.P @ one.x + qp.g @ one.x for one in (found, true)]
            assert cost[0] == pytest.approx(cost[1], rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_what_is_granted_beyond_the_budget_is_granted_once(solver: str, counted) -> None:
    """One QP after another that has no quick answer; before, each attempt got it anew."""
    qp, work = recorded("curvatures_far_apart 0"), Work(300.0)
    work.least = 600.0
    assert work.left == 600.0
    for _ in range(8):
        make_backend(solver).solve(qp, work=work)
    assert 0.0 <= work.left < 300.0
    assert sum(counted) <= 300.0 + work.least


@pytest.mark.parametrize("name", RECORDED)
@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_the_same_work_gives_the_same_bits_and_plenty_changes_nothing(name, solver) -> None:
    qp = recorded(name)
    for budget in BUDGETS:
        first, second = (make_backend(solver).solve(qp, work=Work(budget)) for _ in range(2))
        assert first.status is second.status and first.iterations == second.iterations
        np.testing.assert_array_equal(first.x, second.x)
    free, plenty = make_backend(solver).solve(qp), make_backend(solver).solve(qp, work=Work(1e9))
    np.testing.assert_array_equal(free.x, plenty.x)
    assert free._replace(solve_time=0.0)[4:7] == plenty._replace(solve_time=0.0)[4:7]


@pytest.mark.parametrize("solver", ["proxqp", "proxqp_cold", "daqp"])
def test_without_work_nobody_is_asked_and_nothing_is_proved(solver: str, counted) -> None:
    work = Work(1.0)
    found = make_backend(solver).solve(infeasible(), work=work)
    assert counted == []
    assert found.status is Status.FAILED and found.conflict is None
    assert "budget" in found.message
    assert work.left_out == ("a search for the rows in conflict",)


@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_a_verdict_comes_with_its_proof_or_not_at_all(solver: str) -> None:
    qp, seen = infeasible(), set()
    for budget in (1.0, 200.0, 500.0, 1000.0, 2800.0):
        found = make_backend(solver).solve(qp, work=Work(budget))
        assert found.status in (Status.INFEASIBLE, Status.FAILED)
        assert (found.conflict is not None) == (found.status is Status.INFEASIBLE)
        seen.add(found.status)
    assert seen == {Status.INFEASIBLE, Status.FAILED}


def test_a_search_is_counted_and_left_out_by_name() -> None:
    qp = infeasible()
    plenty, little = Work(1e6), Work(search(qp) - 1.0)
    assert find_conflict(qp, work=plenty) is not None and plenty.left_out == ()
    assert 0.0 < plenty.spent < 2.0 * search(qp)
    assert find_conflict(qp, work=little) is None
    assert little.spent == 0.0 and little.left_out == ("a search for the rows in conflict",)


def test_the_least_infeasible_point_needs_no_second_problem() -> None:
    """What misses the rows by as little is found first; the best of these where work is left."""
    qp, little = infeasible(), Work(1.0)
    best, any_one = least_infeasible(qp), least_infeasible(qp, work=little)
    assert best.optimal and not any_one.optimal
    assert little.left_out == ("the best of the least infeasible commands",)
    assert set(any_one.slack) == set(best.slack) and 0.0 < little.spent < 1500.0


@needs_core
@needs_direct_daqp
def test_the_core_is_asked_for_no_more_than_is_left(monkeypatch) -> None:
    """It counts its iterations where it finds no answer as well."""
    qp, asked = recorded("curvatures_far_apart 0"), []
    honest = NativeDaqp.solve

    def noted(self, qp, name, quick=False, work=None, most=None):
        before = work.spent
        found = honest(self, qp, name, quick, work, most)
        asked.append((most, work.spent - before))
        return found

    monkeypatch.setattr(NativeDaqp, "solve", noted)
    for budget in BUDGETS:
        asked.clear()
        Daqp().solve(qp, work=Work(budget))
        for most, spent in asked:
            assert spent <= ACTIVE_SET.units(qp, most) <= budget
    for most in (1, 10):
        work = Work()
        solver = Daqp()._native
        assert solver is not None
        assert honest(solver, qp, "daqp", False, work, most) is None
        assert work.spent == pytest.approx(ACTIVE_SET.units(qp, most), abs=2.0)


def test_a_hurried_warm_attempt_leaves_the_next_its_time(solvable) -> None:
    """The cap on the iterations of a kept workspace is that of its next caller."""
    rng = np.random.default_rng(11)
    qp, backend = solvable(rng), ProxQP()
    assert backend.solve(qp).solved
    (kept,) = backend._workspaces.values()
    usual = kept.native.settings.max_iter
    work = Work(3000.0)
    work.spent = 3000.0 - (ACTIVE_SET.units(qp, 120) + search(qp) + WARM.units(qp, 3 * INNER))
    assert work.short and backend.solve(qp, work=work).solver == "proxqp"
    assert kept.native.results.info.iter_ext <= 3
    assert kept.native.settings.max_iter == usual
