"""What a QP solver cannot do at a level is said when the controller is made, and what it misses."""

from collections import Counter

import numpy as np
import pytest

import wbc
from tests.needs import needs_bench
from wbc.qp import QP, Solution, Status, make_backend
from wbc.qp.active_set import ActiveSet
from wbc.qp.backend import torque_level_doubt

pytestmark = needs_bench
# Those of which nothing is said solve so many of the torque ticks that have a solution.
SHARE = 0.99


def controller(robot, level: str, solver):
    start = robot.snapshot(robot.posture("standing"))
    tasks = [wbc.ComTask(robot, start.com, weight=30.0), wbc.PostureTask(robot, start.q)]
    kind = wbc.TorqueController if level == "torque" else wbc.KinematicController
    limits = wbc.Limits(robot)
    return kind(robot, tasks, contacts=wbc.support(start, "double"), limits=limits, solver=solver)


def who_answered(robot, solver: str, count: int) -> Counter[str]:
    """Return by whom torque ticks from calm and from moved states were solved, if not relaxed."""
    one, rng, seen = controller(robot, "torque", solver), np.random.default_rng(1), Counter[str]()
    q = robot.posture("standing")
    for k in range(count):
        speed, turn = (0.02, 0.002) if k % 2 else (0.3, 0.02)
        step = np.concatenate((np.zeros(6), turn * rng.normal(size=robot.nv - 6)))
        here = robot.snapshot(robot.integrate(q, step, 1.0), speed * rng.normal(size=robot.nv))
        tick = one.step(here)
        assert tick.ok, tick.report()
        if tick.policy is None:
            seen[tick.solution.solver] += 1
    return seen


@pytest.mark.slow
@pytest.mark.parametrize("robot_name", ["hoap2_like", "g1"])
@pytest.mark.parametrize("solver", ["clarabel", "daqp", "piqp"])
def test_solvers_of_which_nothing_is_said_solve_torque_ticks(
    robot_named, solver, robot_name, caplog
) -> None:
    seen = who_answered(robot_named(robot_name), solver, 100)
    assert sum(seen.values()) > 90 and seen[solver] >= SHARE * sum(seen.values())
    assert not [record for record in caplog.records if solver in record.getMessage()]


def test_what_osqp_leaves_is_said_before_and_when_the_core_answers(hoap2, caplog) -> None:
    """Once each, though it is many ticks; every tick is answered, and says by whom."""
    seen = who_answered(hoap2, "osqp", 20)
    assert seen["active_set"] >= 1 and {*seen} <= {"osqp", "active_set"}
    told = [record.getMessage() for record in caplog.records if "'osqp'" in record.getMessage()]
    assert len(told) == 2
    assert "torque level" in told[0] and "'active_set' answers" in told[0]
    assert "left a QP unsolved" in told[1] and "'active_set' answered" in told[1]


def test_solvers_are_doubted_at_the_torque_level_alone(hoap2, caplog, monkeypatch) -> None:
    controller(hoap2, "velocity", "osqp")
    assert not caplog.records
    for name in ("active_set", "proxqp", "proxqp_cold", "clarabel", "daqp", "piqp"):
        assert torque_level_doubt(make_backend(name)) is None
    ecos = make_backend("piqp")
    ecos.name = "ecos"
    assert "never measured" in torque_level_doubt(ecos)
    ecos.name = "qpoases"
    assert torque_level_doubt(ecos) is None  # somebody's own
    monkeypatch.setattr("wbc.qp.backend.qpsolvers_names", lambda: ("qpoases",))
    assert "never measured" in torque_level_doubt(ecos)
    assert "no inequality rows" in torque_level_doubt(make_backend("pseudo_inverse"))


class Stranger:
    """A backend of somebody's own, which solves nothing."""

    name = "stranger"

    def solve(self, qp: QP, workspace=None, quick: bool = False) -> Solution:
        found = ActiveSet().solve(qp)
        return found._replace(
            x=np.full(qp.g.size, np.nan),
            status=Status.FAILED,
            solver="stranger",
            message="no",
            solve_time=1.0,
        )


@pytest.mark.parametrize("level", ["velocity", "torque"])
def test_what_a_strange_backend_misses_the_core_answers(hoap2, level, caplog) -> None:
    one, other = controller(hoap2, level, Stranger()), controller(hoap2, level, "active_set")
    here = hoap2.snapshot(hoap2.posture("standing"))
    for _ in range(3):
        tick = one.step(here)
        assert tick.ok and tick.solution.solver == "active_set" and tick.solution.attempts == 2
        assert 1.0 < tick.solution.solve_time < 2.0
        np.testing.assert_allclose(tick.velocity, other.step(here).velocity, atol=1e-7)
    told = [record.getMessage() for record in caplog.records]
    assert told == [
        "QP solver 'stranger' left a QP unsolved (no); 'active_set' answered, as it will others"
    ]
