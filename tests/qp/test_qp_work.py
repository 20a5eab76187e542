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
from wbc.qp.kkt import SolveCheck
from wbc.qp.least_infeasible import least_infeasible
from wbc.qp.native import Workspace
from wbc.qp.native_daqp import NativeDaqp
from wbc.qp.pause import Pauses
from wbc.qp.proxqp import _outer
from wbc.qp.work import (
    ACTIVE_SET,
    COLD,
    FEWEST,
    INNER,
    POLISH,
    WARM,
    Steps,
    Work,
    afforded_search,
    otherwise,
    search,
)

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


def sized(n: int, me: int = 0, mi: int = 0) -> QP:
    """Return a QP of these sizes, without numbers."""
    return QP.build(np.eye(n), np.zeros(n), A=np.zeros((me, n)), b=np.zeros(me),
                    C=np.zeros((mi, n)), l=-np.ones(mi), u=np.ones(mi))  # fmt: skip


def test_what_is_spent_and_what_is_kept_both_leave_less_room() -> None:
    work = Work(100.0)
    assert work.is_limited and not Work().is_limited and Work().left == np.inf
    work.spent, work.kept = 30.0, 20.0
    assert work.left == 50.0  # 100 - 30 - 20
    assert work.has_room(50.0) and not work.has_room(50.5)
    assert work.affords(50.0, "this") and work.left_out == ()
    assert not work.affords(51.0, "that") and not work.affords(52.0, "that")
    work.leave_out("more")
    assert work.left_out == ("that", "more")  # each once
    assert work.spent == 30.0  # to ask takes nothing
    work.spent = 65.0
    assert not work.short
    work.spent = 65.5
    assert work.short


@pytest.mark.parametrize(
    ("spent", "kept", "left"),
    [
        (0.0, 0.0, 100.0),
        (80.0, 0.0, 40.0),  # 20 are left, and 40 granted whatever is left
        (80.0, 15.0, 40.0),  # what is kept does not take from what is granted
        (40.0, 15.0, 45.0),
        (100.0, 0.0, 40.0),
        (125.0, 0.0, 15.0),  # 25 of the 40 are used
        (150.0, 0.0, 0.0),
        (150.0, 10.0, 0.0),
    ],
)
def test_what_is_granted_is_there_whatever_is_left(spent: float, kept: float, left: float) -> None:
    work = Work(100.0)
    work.spent, work.kept, work.least = spent, kept, 40.0
    assert work.left == left


def test_what_calls_take_of_a_humanoids_qp_in_units() -> None:
    """35 unknowns, 12 + 25 rows: 35 (35 + 37) = 2520 entries; as measured when they were chosen."""
    qp, n = sized(35, 12, 25), 35
    assert ACTIVE_SET.units(qp) == pytest.approx(95.2)
    assert ACTIVE_SET.step(n) == pytest.approx(1.715)
    assert COLD.units(qp) == pytest.approx(245.6)
    assert WARM.units(qp) == pytest.approx(165.6)
    assert COLD.step(n) == WARM.step(n) == pytest.approx(14.0)
    assert POLISH.units(qp) == pytest.approx(402.0)
    assert search(qp) == pytest.approx(466.8)  # 72 unknowns and slacks, 4.32 units a step
    assert otherwise(qp) == pytest.approx(95.2 + 120 * 1.715 + 466.8)
    assert WARM.units(qp, 6) == pytest.approx(165.6 + 84.0)
    assert (INNER, FEWEST) == (6, 25)


@pytest.mark.parametrize("steps", [ACTIVE_SET, COLD, Steps(3.0, 0.5, one=2.0, two=0.25)])
@pytest.mark.parametrize("sizes", [(1,), (8, 2, 3), (35, 12, 25)])
def test_as_many_steps_are_afforded_as_fit(steps: Steps, sizes: tuple[int, ...]) -> None:
    """Oracle: one after the other is counted."""
    qp = sized(*sizes)
    for left in (0.0, steps.units(qp), *np.linspace(1.0, 900.0, 40)):
        fit = 0
        while fit < 30 and steps.units(qp, fit + 1) <= left:
            fit += 1
        assert steps.afforded(qp, left, 30) == fit
        assert steps.afforded(qp, left, 30, least=12) == (fit if fit >= 12 else 0)
        assert steps.afforded(qp, left, 8, least=12) == (8 if fit >= 8 else 0)
        assert steps.afforded(qp, left, 0) == 0
        outer = _outer(steps, qp, left, 5)
        assert outer == fit // INNER


def test_qps_without_unknowns_take_a_call_and_no_steps() -> None:
    """Such as are left where equalities fix every unknown."""
    none = np.zeros((0, 0))
    qp = sized(1)._replace(P=none, g=np.zeros(0), A=none, C=none)
    assert ACTIVE_SET.units(qp, 50) == ACTIVE_SET.call
    assert ACTIVE_SET.afforded(qp, 1e3, 30) == 30


def test_a_search_gets_its_usual_steps_or_as_many_as_are_afforded() -> None:
    qp = sized(35, 12, 25)
    assert afforded_search(qp, 0.0, 1000) == afforded_search(qp, search(qp), 1000) == 40
    for steps in (41, 70, 200):
        left = search(qp, steps) + 0.5
        assert afforded_search(qp, left, 1000) == steps
        assert afforded_search(qp, left, 41) == 41
    assert afforded_search(qp, np.inf, 1000) == 1000
    assert afforded_search(qp, 0.0, 10) == 10


def test_fewer_changes_of_an_active_set_than_are_worth_it_are_no_attempt(monkeypatch) -> None:
    """Half of what is left is for this attempt: 25 changes are begun, and what affords 24 not."""
    monkeypatch.setattr(DaqpMemory, "solve", lambda self, most: pytest.fail(f"asked for {most}"))
    qp = infeasible()
    below = Work(2.0 * ACTIVE_SET.units(qp, FEWEST) - 0.5)
    assert "budget" in Daqp().answer(qp, below).message and below.spent == 0.0
    with pytest.raises(pytest.fail.Exception, match="asked for 25"):
        Daqp().answer(qp, Work(2.0 * ACTIVE_SET.units(qp, FEWEST) + 0.5))


def test_pauses_last_a_hundred_qps_then_twice_as_many_up_to_a_minute() -> None:
    pauses, found = Pauses(), []
    assert not pauses.goes_on("a") and not pauses
    for _ in range(11):
        pauses.begin("a")
        assert not pauses.goes_on("b")
        length = 0
        while pauses.goes_on("a"):
            length += 1
        assert not pauses.goes_on("a")  # and does not begin again by itself
        found.append(length)
    assert found == [100, 200, 400, 800, 1600, 3200, 6400, 12_800, 25_600, 25_600, 25_600]
    pauses.begin("b")
    assert sum(pauses.goes_on("b") for _ in range(300)) == 100


def test_to_settle_an_active_set_is_counted_or_left_out(solvable) -> None:
    """A rough answer becomes exact where there is room, and is not accepted where there is none."""
    qp, backend = solvable(np.random.default_rng(4)), ProxQP()
    exact = Daqp().answer(qp)
    rough = exact._replace(x=exact.x + 1e-4)
    check = SolveCheck("proxqp", 1e-8, 0.0)
    for spent in (0.0, 50.0):
        work = Work(50.0 + POLISH.units(qp) + 1e-9)
        work.spent = spent
        found = backend._finish(qp, check, rough, 2, work)
        assert found is not None and found.residuals.dual < 1e-8
        assert work.spent == pytest.approx(spent + 150.0 + 0.1 * 8 * (8 + 2 + 4))
    work.spent = 51.0
    assert backend._finish(qp, check, rough, 2, work) is None and work.spent == 51.0
