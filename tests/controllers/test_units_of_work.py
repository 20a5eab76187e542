"""Units of work: of solvers, of a level, and of the usual budget, as measured and written down."""

import numpy as np
import pytest

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.asking import Solvers
from wbc.controllers.work import likely_work, units_of, work_of
from wbc.qp import QP, ProxQP
from wbc.qp.solution import Conflict
from wbc.tasks import ComTask, PositionTask, PostureTask

DT = 0.005


@pytest.fixture
def here(robot_named):
    robot = robot_named("hoap2_like")
    return robot.snapshot(robot.posture("standing"))


@pytest.mark.parametrize(
    ("solver", "call", "one"),
    [
        ("proxqp", 80.0, 35.0),
        ("proxqp_cold", 250.0, 35.0),
        ("daqp", 60.0, 4.0),
        ("active_set", 150.0, 3.0),
        ("piqp", 400.0, 15.0),
        ("osqp", 1500.0, 2.5),
        ("clarabel", 1300.0, 0.0),
    ],
)
def test_solvers_take_the_units_that_were_measured(solver: str, call: float, one: float) -> None:
    """For a call and each iteration, an attempt in vain, a search for rows in conflict."""
    found = ProxQP().solve(QP.build(np.eye(1), [0.0]))._replace(solver=solver, iterations=0)
    assert found.attempts == 1 and found.conflict is None
    assert work_of(found) == call
    assert work_of(found._replace(iterations=7)) == call + 7 * one
    assert work_of(found._replace(attempts=3)) == call + 1400.0
    assert work_of(found._replace(conflict=Conflict(()))) == call + 600.0
    assert likely_work(solver) == call + 20 * one


def test_the_usual_budget_is_half_as_much_again_as_the_levels_take_once(robot_named) -> None:
    """And 2400 units at least; a level: 2 for each unknown, 11 more below the first, and DAQP."""
    assert units_of("usual", 1599.0) == 2400.0 and units_of("usual", 2000.0) == 3000.0
    assert units_of(7, 1e6) == 7.0 and units_of(None, 1e6) == np.inf
    robot = robot_named("g1")
    q = robot.posture("standing")
    tasks = [PostureTask(robot, q, name=f"{k}", priority=k) for k in range(6)]
    controller = KinematicController(robot, tasks, contacts=())
    once = 2 * robot.nv + 5 * 13 * robot.nv + 6 * (60 + 20 * 4)
    assert controller.budget == pytest.approx(1.5 * once) and once > 1600.0


@pytest.mark.parametrize(
    ("braking", "formulation", "threshold", "first", "second"),
    [
        ("free", "equality", 0.0, 2.0, 13.0),
        ("bounded", "equality", 0.0, 4.5, 15.5),
        ("free", "reduced", 0.0, 6.5, 13.0),
        ("free", "equality", 1e-3, 2.0, 18.0),
    ],
)
def test_what_surrounds_the_solvers_is_counted_by_unknowns(
    here, monkeypatch, braking, formulation, threshold, first, second
) -> None:
    """Units before each call of a solver, what calls took left out; and what they are told."""
    robot, honest = here.robot, Solvers.solve
    told: list[tuple[float, float, float]] = []

    def solve(self, qp, work, workspace, quick=False, below=0.0):
        before = work.spent
        told.append((before, work.least, below))
        found = honest(self, qp, work, workspace, quick, below)
        work.spent = before
        return found

    monkeypatch.setattr(Solvers, "solve", solve)
    hand = here.position("left_hand") + 1e-3
    tasks = [
        ComTask(robot, here.com),
        PositionTask(robot, "left_hand", hand, priority=1, singular_threshold=threshold),
    ]
    tick = KinematicController(
        robot, tasks, contacts=support(here, "double"), dt=DT, formulation=formulation,
        limits=Limits(robot, braking=braking), budget=None,
    ).step(here)  # fmt: skip
    assert tick.ok and len(told) == 2
    n, (start, below) = robot.nv, np.array([told[0][0], told[1][0]])
    assert start == first * n and below - start == second * n
    # The first level may take 600 units beyond; it is told what the other will take.
    assert [one[1:] for one in told] == [(600.0, 13.0 * n), (0.0, 0.0)]
