"""A tick's work is counted: what its budget does not afford is left out, by name, and no more."""

import numpy as np
import pytest

from tests.controllers.test_look_ahead import DT, Slow, outcome
from tests.needs import needs_core, needs_direct_daqp
from wbc.constraints import Limits, SelfCollision, support
from wbc.constraints.contact import Contact
from wbc.controllers import KinematicController
from wbc.controllers.look_ahead import MarginRows, solve_with_look_ahead
from wbc.controllers.slack import Slacks
from wbc.controllers.work import work_of
from wbc.errors import InvalidInputError
from wbc.qp import QP, ProxQP, Status
from wbc.qp.backend import installed_solvers
from wbc.qp.daqp import Daqp
from wbc.qp.daqp_direct import iteration_limit
from wbc.qp.qpsolvers_backend import QpsolversBackend
from wbc.qp.work import ACTIVE_SET, COLD, Work
from wbc.tasks import ComTask, PositionTask, PostureTask


@pytest.fixture
def here(robot_named):
    robot = robot_named("hoap2_like")
    return robot.snapshot(robot.posture("standing"))


def stack_of(here, levels: int):
    """Return tasks on so many levels, the posture last."""
    robot = here.robot
    first = ComTask(robot, here.com + 0.001)
    hand = PositionTask(robot, "left_hand", here.position("left_hand") + 0.01, priority=1)
    q = robot.posture("standing", {"right_elbow_pitch": -0.2}, on_ground=False)
    return [*[first, hand][: levels - 1], PostureTask(robot, q, priority=levels - 1)]


def controller(here, levels: int = 3, constraints=(), **settings) -> KinematicController:
    return KinematicController(
        here.robot,
        stack_of(here, levels),
        contacts=(),
        limits=Limits(here.robot, acceleration=1e4),
        constraints=constraints,
        dt=DT,
        **settings,
    )


@pytest.fixture
def solved(monkeypatch):
    """Return the list of the sizes of all QPs that DAQP and ProxQP were asked for."""
    sizes: list[int] = []
    for kind in (Daqp, ProxQP):
        honest = kind.solve

        def counted(self, qp, *given, honest=honest, **named):
            sizes.append(qp.g.size)
            return honest(self, qp, *given, **named)

        monkeypatch.setattr(kind, "solve", counted)
    return sizes


@pytest.fixture
def stubborn(monkeypatch):
    """Have ProxQP fail what will not come again; return the workspaces that it was asked for."""
    honest, asked = ProxQP.solve, []

    def solve(self, qp, workspace="default", quick=False):
        found = honest(self, qp, workspace, quick)
        asked.append(workspace)
        return found if workspace else found._replace(status=Status.FAILED, conflict=None)

    monkeypatch.setattr(ProxQP, "solve", solve)
    return asked


def test_levels_that_are_not_afforded_are_left_out_by_name(here, solved) -> None:
    """Levels above are solved as if there were none below; which are left out is said."""
    whole = controller(here, budget=None)
    everything = whole.step(here)
    assert everything.left_out == () and everything.report() == "solved"
    assert len(solved) == 3
    solved.clear()
    tick = controller(here, budget=1.0).step(here)
    assert len(solved) == 1
    assert tick.ok and tick.policy is None
    assert [text.split(":")[0] for text in tick.left_out] == ["level 1"]
    hand, com = (task.name for task in whole.tasks[1::-1])
    assert hand in tick.left_out[0] and hand in tick.report() and com not in tick.report()
    assert set(tick.errors) == {task.name for task in whole.tasks}  # what is wrong is said still
    jacobian = whole.tasks[0].residual(here).jacobian
    np.testing.assert_allclose(jacobian @ tick.velocity, jacobian @ everything.velocity, atol=1e-7)
    assert np.abs(tick.velocity - everything.velocity).max() > 1e-3


def test_a_budget_that_suffices_changes_nothing(here) -> None:
    usual, boundless = controller(here), controller(here, budget=None)
    assert np.isfinite(usual.budget) and boundless.budget == np.inf
    for _ in range(3):
        tick = usual.step(here)
        assert tick.left_out == ()
        np.testing.assert_array_equal(tick.velocity, boundless.step(here).velocity)


def test_the_same_input_leaves_out_the_same(here) -> None:
    """Work is counted and not clocked: a tick that takes longer does no less."""
    for budget in (300.0, 900.0, 1500.0):
        first, second = (
            controller(here, constraints=[Slow(here.robot, 0.1, useful=True)], budget=budget)
            for _ in range(2)
        )
        for one in (first, second):
            one.constraints[0].start = here.q
        ticks = first.step(here), second.step(here)
        assert ticks[0].left_out == ticks[1].left_out != ()
        np.testing.assert_array_equal(ticks[0].velocity, ticks[1].velocity)


@pytest.mark.parametrize(("budget", "solves", "looks"), [(None, 6, 4), (1.0, 1, 1)])
def test_cuts_and_looks_are_bounded(here, solved, budget, solves: int, looks: int) -> None:
    """Two rounds of three levels, or one QP: what leads inside is not commanded either way."""
    constraint = Slow(here.robot, 0.05, useful=True)
    constraint.start = here.q
    tick = controller(here, constraints=[constraint], budget=budget).step(here)
    assert len(solved) == solves and len(constraint.tried) == looks
    assert np.abs(tick.velocity).max() <= 0.05 + 1e-6
    assert bool(tick.left_out) == (budget is not None)


def test_what_bounds_show_to_be_safe_needs_no_look(here) -> None:
    """A smaller step may be proved by its curvature bound alone: the robot goes on."""

    class Bounded(Slow):
        def may_violate(self, rows, v, dt) -> bool:
            return float(np.abs(v).max()) > self.most

    fast = np.abs(controller(here, budget=1.0).step(here).velocity).max()
    constraint = Bounded(here.robot, 0.3 * fast, useful=False)
    constraint.start = here.q
    tick = controller(here, constraints=[constraint], budget=1.0).step(here)
    assert tick.step_scale == 0.25 and len(constraint.tried) == 1
    assert 0.0 < np.abs(tick.velocity).max() <= constraint.most


def test_a_level_that_one_attempt_does_not_solve_is_left_out(here, stubborn, monkeypatch) -> None:
    """From most of the budget on; before, a tick without all its levels has failed."""
    alone, work = controller(here, levels=2), Work(1000.0)
    assert alone.step(here).status is Status.FAILED
    monkeypatch.setattr(Work, "short", property(lambda self: True))
    tick = alone.step(here)
    assert tick.ok and [text.split(":")[0] for text in tick.left_out] == ["level 1"]
    assert work.left_out == ()


def test_a_level_with_too_little_left_is_left_out(here, stubborn, monkeypatch) -> None:
    """Even where most of the budget is not spent: what is kept for looks is nobody's to take."""
    monkeypatch.setattr("wbc.controllers.levels.otherwise", lambda qp: 1e9)
    tick = controller(here, levels=2).step(here)
    assert tick.ok and [text.split(":")[0] for text in tick.left_out] == ["level 1"]


@needs_core
@pytest.mark.parametrize(("budget", "times"), [(None, 2), ("usual", 1)])
def test_a_plain_tick_without_a_solution_is_not_solved_twice(here, solved, budget, times) -> None:
    """Where work is counted: the QP that Python would set up is that of the core, to rounding."""
    where, turn = here.position("left_foot"), here.rotation("left_foot")
    elsewhere = Contact(here.robot, "left_foot", where + [0.1, 0.0, 0.0], turn)
    tasks = [ComTask(here.robot, here.com)]
    limits, held = Limits(here.robot), [Contact.hold(here, "left_sole"), elsewhere]
    asked = KinematicController(
        here.robot, tasks, contacts=held, limits=limits, dt=DT, budget=budget
    )
    tick = asked.step(here)
    assert tick.status is Status.INFEASIBLE and tick.solution.conflict is not None
    assert not tick.velocity.any() and len(solved) == times


@needs_core
@needs_direct_daqp
def test_what_the_core_took_is_counted(here) -> None:
    """Ticks that it hands over go on with what it left of the budget."""
    one = KinematicController(here.robot, stack_of(here, 1), contacts=(), dt=DT, solver="daqp")
    assert one.native.spent < 1000.0
    assert one.step(here).ok
    memory = one.native.memory
    before, n = one.native.spent, here.robot.nv
    assert before == ACTIVE_SET.call + ACTIVE_SET.step(n) * memory.iterations
    memory.out[memory.answer.found] = 101.0, 0.0, 0.0, -4.0  # as many, and no answer
    assert one.native.spent == ACTIVE_SET.call + ACTIVE_SET.step(n) * 101
    memory._proximal = 10
    assert one.native.spent > before + 10 * COLD.step(n)


@needs_core
@needs_direct_daqp
def test_the_core_takes_no_more_than_half_of_a_budget(here) -> None:
    limits = []
    for budget in (None, 400.0, 1e6):
        one = KinematicController(
            here.robot, stack_of(here, 1), contacts=(), dt=DT, solver="daqp", budget=budget
        )
        limits.append(int(iteration_limit(one.native.memory._settings)[0]))
    assert limits[0] == limits[2] == Daqp().max_iterations
    n = here.robot.nv
    assert 1 < limits[1] <= 200.0 / ACTIVE_SET.step(n)


def test_cuts_that_one_attempt_does_not_solve_are_left_out(here, stubborn, monkeypatch) -> None:
    """From most of the budget on a part of the answer without them is commanded, looked at."""
    fast = np.abs(controller(here, levels=1).step(here).velocity).max()
    constraint = Slow(here.robot, 0.3 * fast, useful=True)
    constraint.start = here.q
    one = controller(here, levels=1, constraints=[constraint])
    assert not one.step(here).ok  # with time for it, no verdict is hidden
    monkeypatch.setattr(Work, "short", property(lambda self: True))
    stubborn.clear()
    tick = one.step(here)
    assert tick.ok and tick.step_scale == 0.25 and len(stubborn) == 2
    assert tick.left_out == ("rows of margins where the command leads",)
    assert 0.0 < np.abs(tick.velocity).max() <= constraint.most


def test_the_verdict_with_a_proof_stays(here) -> None:
    """Where margins relaxed in a hurry give no verdict, that of the QP with them stands."""
    n = here.robot.nv
    row = np.eye(n)[:1]
    qp = QP.build(np.eye(n), np.zeros(n), C=row, l=[1.0], u=[2.0], upper=np.zeros(n))
    proved = ProxQP().solve(qp)
    assert proved.conflict is not None
    unproved = proved._replace(status=Status.FAILED, conflict=None)
    margins = MarginRows.at(here, [Slow(here.robot, 0.5, useful=True)], Slacks({}, [], []), DT)
    answers = [proved, unproved]

    def solve(bounds, box):
        found = outcome("lower limit")
        return found._replace(qp=qp, first=qp, solution=answers.pop(0))

    attempt = solve_with_look_ahead(solve, margins, [])
    assert not answers and attempt.outcome.solution.conflict is proved.conflict


@pytest.mark.skipif("piqp" not in installed_solvers(), reason="needs wbc[bench]")
def test_slow_solvers_answer_while_there_is_time(here, monkeypatch) -> None:
    """Where the levels below are afforded beside them; DAQP answers all others."""
    asked, honest = [], QpsolversBackend.solve
    monkeypatch.setattr(
        QpsolversBackend,
        "solve",
        lambda self, qp, *a, **k: asked.append(k.get("quick", False)) or honest(self, qp, *a, **k),
    )
    everything = controller(here, solver="piqp", budget=None).step(here)
    assert asked == [False] * 3 and everything.solution.solver == "piqp"
    asked.clear()
    tick = controller(here, solver="piqp").step(here)
    assert tick.ok and set(asked) == {True}  # in few iterations
    np.testing.assert_allclose(tick.velocity, everything.velocity, atol=1e-5)
    asked.clear()
    tick = controller(here, levels=2, solver="piqp", budget=1.0).step(here)
    assert asked == [] and tick.ok and tick.solution.solver == "daqp"


def test_what_is_no_budget_is_refused(here) -> None:
    for bad in (0.0, -1.0, np.nan, "much", np.inf):
        with pytest.raises(InvalidInputError, match="budget"):
            controller(here, budget=bad)


def test_iterations_attempts_and_proofs_are_work() -> None:
    found = ProxQP().solve(QP.build(np.eye(2), np.ones(2)))
    more = found._replace(iterations=found.iterations + 4)
    assert 0.0 < work_of(found) < work_of(more) < work_of(more._replace(attempts=2))
    infeasible = ProxQP().solve(
        QP.build(np.eye(1), [0.0], C=[[1.0]], l=[1.0], u=[2.0], upper=[0.0])
    )
    assert work_of(infeasible) > work_of(infeasible._replace(conflict=None)) > 0.0


@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_the_usual_budget_affords_every_level_of_a_usual_tick(robot_named, solver: str) -> None:
    """However many there are: what is left out is the price of trouble, not of asking for more."""
    robot = robot_named("g1")
    start = robot.snapshot(robot.posture("standing"))
    q = robot.posture("standing", {"*elbow*": 0.4, "*shoulder_roll*": 0.1})
    names = ["*elbow*", "*shoulder*", "waist*", "*wrist*", "*"]
    tasks = [ComTask(robot, start.com + 0.005)]
    for level, pattern in enumerate(names, 1):
        joints = {"*": 0.0, pattern: 1.0}
        tasks.append(PostureTask(robot, q, joints=joints, name=f"part {level}", priority=level))
    controller = KinematicController(
        robot,
        tasks,
        contacts=support(start, "double"),
        limits=Limits(robot),
        constraints=[SelfCollision(robot)],
        solver=solver,
    )
    now = start
    for _ in range(3):
        tick = controller.step(now)
        assert tick.ok and tick.left_out == ()
        now = robot.snapshot(robot.integrate(now.q, tick.velocity, DT), tick.velocity)
    assert controller.budget > 1.2 * KinematicController(robot, tasks[:1], contacts=()).budget
    with pytest.raises(InvalidInputError, match="make another controller"):
        controller.budget = 1.0
