"""Searching in several processes: the same answers, budgets, interruption, and lost processes."""

import os
import signal
import threading

import numpy as np
import pytest

from wbc.controllers.shaping import GlobalShaping
from wbc.controllers.shaping import shaping as shaping_module
from wbc.controllers.shaping.nlp import Start, build_nlp
from wbc.controllers.shaping.team import NOTHING, Team
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.tasks import InertiaTask


def shaping_of(robot: Robot) -> GlobalShaping:
    q = robot.posture()
    moments = np.diag(robot.snapshot(q).inertia_in("base"))
    return GlobalShaping(robot, [InertiaTask(robot, np.diag(moments * [1.5, 1.5, 0.3]),
                                             frame="base", per_mass=True)])  # fmt: skip


def test_answers_do_not_depend_on_who_searched(robot_named) -> None:
    robot = robot_named("hoap2_like")
    shaping, q = shaping_of(robot), robot.posture()
    seen: list[tuple[int, int, float | None]] = []
    alone = shaping.solve(q, 40, workers=1)
    shared = shaping.solve(q, 40, workers=2, progress=lambda *news: seen.append(news))
    assert [c.cost for c in alone.candidates] == [c.cost for c in shared.candidates]
    assert [c.starts for c in alone.candidates] == [c.starts for c in shared.candidates]
    assert [done for done, _, _ in seen] == list(range(1, 41))
    assert {total for _, total, _ in seen} == {40}
    best = [cost for _, _, cost in seen]
    assert best == sorted(best, reverse=True)
    assert best[-1] == shared.best.cost
    assert shared.statistics.stopped is None
    assert sorted(k for c in shared.candidates for k in c.starts) == list(range(40))
    other = shaping.solve(q, 40, workers=1, seed=1)
    assert [c.cost for c in other.candidates] != [c.cost for c in alone.candidates]


def test_no_more_is_searched_when_the_tasks_are_met(robot_named) -> None:
    """The inertia of a posture can be had exactly, from nearly every start."""
    robot = robot_named("hoap2_like")
    q = robot.posture()
    joints = {"*_elbow_pitch": -1.0, "*_hip_pitch": -0.8, "*_knee_pitch": 1.2}
    wanted = robot.snapshot(robot.posture("standing", joints)).inertia_in("base")
    shaping = GlobalShaping(robot, [InertiaTask(robot, wanted, frame="base", per_mass=True)])
    alone, shared = (shaping.solve(q, 200, workers=workers) for workers in (1, 2))
    for outcome in (alone, shared):
        assert outcome.statistics.stopped == "met"
        assert outcome.statistics.searched < 50
        assert outcome.best.cost < 1e-12
    assert [c.cost for c in alone.candidates] == [c.cost for c in shared.candidates]


def test_the_time_budget_ends_the_search_after_the_first_start(robot_named) -> None:
    robot = robot_named("hoap2_like")
    outcome = shaping_of(robot).solve(robot.posture(), 500, seconds=1e-6, workers=1)
    assert outcome.statistics.stopped == "seconds"
    assert outcome.statistics.searched == 1
    assert outcome.best.starts == (0,)


def test_an_interruption_keeps_what_was_found(robot_named) -> None:
    robot = robot_named("hoap2_like")

    def interrupt(done: int, total: int, cost: float | None) -> None:
        if done == 3:
            raise KeyboardInterrupt

    outcome = shaping_of(robot).solve(robot.posture(), 500, workers=2, progress=interrupt)
    assert outcome.statistics.stopped == "interrupted"
    assert outcome.statistics.searched == 3
    assert outcome.candidates


def test_ctrl_c_inside_ipopt_ends_the_search(robot_named) -> None:
    robot = robot_named("hoap2_like")
    timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))

    def in_a_while(done: int, total: int, cost: float | None) -> None:
        if done == 1:
            timer.start()

    outcome = shaping_of(robot).solve(robot.posture(), 500, workers=1, progress=in_a_while)
    timer.join()
    assert outcome.statistics.stopped == "interrupted"
    assert 1 <= outcome.statistics.searched < 500
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.fixture
def teams(monkeypatch: pytest.MonkeyPatch) -> list[Team]:
    """The teams that are made during the test."""
    made: list[Team] = []

    class Watched(Team):
        def __init__(self, *args) -> None:
            super().__init__(*args)
            made.append(self)

    monkeypatch.setattr(shaping_module, "Team", Watched)
    return made


def test_a_search_that_was_taken_and_lost_is_repeated(robot_named, teams) -> None:
    robot = robot_named("hoap2_like")
    shaping, q = shaping_of(robot), robot.posture()
    expected = shaping.solve(q, 6, workers=1)
    took: list[int | None] = []

    def steal(done: int, total: int, cost: float | None) -> None:
        if done == 1:
            took.append(teams[-1].take())

    outcome = shaping.solve(q, 6, workers=1, progress=steal)
    assert took == [1]
    assert [c.cost for c in outcome.candidates] == [c.cost for c in expected.candidates]


def test_who_is_woken_by_starts_may_take_one(robot_named) -> None:
    """A process that asks as soon as they come finds them ready; else it waited for the next."""
    robot = robot_named("hoap2_like")
    built = build_nlp(shaping_of(robot).problem)
    took: list[int | None] = []

    class Woken:
        def post(self, starts: list[Start]) -> None:
            took.append(team.take())

        def dismiss(self) -> None:
            took.append(NOTHING)

    with Team(built.nlp, 0, None) as team:
        team._members.append(Woken())  # type: ignore[arg-type]
        team.offer([built.start(robot.posture())])
    assert took == [0, NOTHING]


def test_nobody_waits_for_a_process_that_was_killed(robot_named, teams) -> None:
    """It dies amid a search; what it was at is done here, and all that comes after."""
    robot = robot_named("hoap2_like")
    shaping, q = shaping_of(robot), robot.posture()
    expected = shaping.solve(q, 40, workers=1)
    held: list[set[int]] = []

    def kill(done: int, total: int, cost: float | None) -> None:
        (member,) = teams[-1]._members
        board = teams[-1]._board
        if done == 1:
            while board.held([1]) == {NOTHING}:  # it is still loading
                os.sched_yield()
            with board._cells.get_lock():  # else it might die with the lock
                os.kill(member._process.pid, signal.SIGSTOP)
                os.kill(member._process.pid, signal.SIGKILL)
            held.append(board.held([1]))

    outcome = shaping.solve(q, 40, workers=2, progress=kill)
    assert held[0] != {NOTHING}
    assert outcome.statistics.stopped is None
    assert outcome.statistics.searched == 40
    assert [c.cost for c in outcome.candidates] == [c.cost for c in expected.candidates]


def test_ctrl_c_does_not_reach_the_others_while_they_load(robot_named, teams) -> None:
    """A terminal sends it to all; only this process answers, and theirs do not print a trace."""
    robot = robot_named("hoap2_like")
    shaping, q = shaping_of(robot), robot.posture()
    alive: list[bool] = []

    def press(done: int, total: int, cost: float | None) -> None:
        if done == 1:
            (member,) = teams[-1]._members
            os.kill(member._process.pid, signal.SIGINT)
            member._process.join(0.3)  # s; time enough to die of it
            alive.append(member._process.is_alive())

    outcome = shaping.solve(q, 3, workers=2, progress=press)
    assert alive == [True]
    assert outcome.statistics.stopped is None
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_the_others_end_with_the_search(robot_named, teams) -> None:
    robot = robot_named("hoap2_like")
    shaping_of(robot).solve(robot.posture(), 3, workers=3)
    (team,) = teams
    assert len(team._members) == 2
    assert not any(member._process.is_alive() for member in team._members)


def test_unusable_numbers_are_refused(robot_named) -> None:
    robot = robot_named("hoap2_like")
    shaping, q = shaping_of(robot), robot.posture()
    with pytest.raises(InvalidInputError, match="starts: must be at least 1"):
        shaping.solve(q, 0)
    with pytest.raises(InvalidInputError, match="workers: must be at least 1"):
        shaping.solve(q, workers=0)
    with pytest.raises(InvalidInputError, match="seconds: must be greater than 0"):
        shaping.solve(q, seconds=0.0)
    with pytest.raises(InvalidInputError, match="seed: must be at least 0"):
        shaping.solve(q, seed=-1)
    with pytest.raises(InvalidInputError, match=r"starts: expected a whole number, got 2\.5"):
        shaping.solve(q, 2.5)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="shape"):
        shaping.solve(q[:-1])
