"""Searching in several processes: the same answers, budgets, interruption, and lost processes."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.shaping import GlobalShaping
from wbc.shaping import search_all as search_module
from wbc.tasks import InertiaTask
from wbc.workers import Workers


def shaping_of(robot: Robot) -> GlobalShaping:
    q = robot.posture()
    moments = np.diag(robot.snapshot(q).inertia_in("base"))
    return GlobalShaping(robot, [InertiaTask(robot, np.diag(moments * [1.5, 1.5, 0.3]),
                                             frame="base", per_mass=True)])  # fmt: skip


@pytest.mark.slow
def test_answers_do_not_depend_on_who_searched(hoap2) -> None:
    shaping, q = shaping_of(hoap2), hoap2.posture()
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


def test_no_more_is_searched_when_the_tasks_are_met(hoap2) -> None:
    """The inertia of a posture can be had exactly, from nearly every start."""
    q = hoap2.posture()
    joints = {"*_elbow_pitch": -1.0, "*_hip_pitch": -0.8, "*_knee_pitch": 1.2}
    wanted = hoap2.snapshot(hoap2.posture("standing", joints)).inertia_in("base")
    shaping = GlobalShaping(hoap2, [InertiaTask(hoap2, wanted, frame="base", per_mass=True)])
    alone, shared = (shaping.solve(q, 200, workers=workers) for workers in (1, 2))
    for outcome in (alone, shared):
        assert outcome.statistics.stopped == "met"
        assert outcome.statistics.searched < 50
        assert outcome.best.cost < 1e-12
    assert [c.cost for c in alone.candidates] == [c.cost for c in shared.candidates]


def test_an_interruption_keeps_what_was_found(hoap2) -> None:

    def interrupt(done: int, total: int, cost: float | None) -> None:
        if done == 3:
            raise KeyboardInterrupt

    outcome = shaping_of(hoap2).solve(hoap2.posture(), 500, workers=2, progress=interrupt)
    assert outcome.statistics.stopped == "interrupted"
    assert outcome.statistics.searched == 3
    assert outcome.candidates


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Ctrl-C counts, also where a shell began the tests in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_inside_ipopt_ends_the_search(hoap2) -> None:
    timer = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT))

    def in_a_while(done: int, total: int, cost: float | None) -> None:
        if done == 1:
            timer.start()

    outcome = shaping_of(hoap2).solve(hoap2.posture(), 500, workers=1, progress=in_a_while)
    timer.join()
    assert outcome.statistics.stopped == "interrupted"
    assert 1 <= outcome.statistics.searched < 500
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


class Watched(Workers):
    """Processes that are remembered."""

    def __init__(self, *given, **named) -> None:
        super().__init__(*given, **named)
        self.processes = []

    def _start(self):
        worker = super()._start()
        self.processes.append(worker.process)
        return worker


@pytest.fixture
def pools(monkeypatch: pytest.MonkeyPatch) -> list[Watched]:
    """The pools that are made during the test."""
    made: list[Watched] = []

    def watched(*given, **named) -> Watched:
        made.append(Watched(*given, **named))
        return made[-1]

    monkeypatch.setattr(search_module, "Workers", watched)
    return made


@pytest.mark.slow
def test_nobody_waits_for_a_process_that_was_killed(hoap2, pools) -> None:
    """It dies amid a search; what it was at is done here, and all that comes after."""
    shaping, q = shaping_of(hoap2), hoap2.posture()
    expected = shaping.solve(q, 40, workers=1)

    def kill(done: int, total: int, cost: float | None) -> None:
        if done == 2:
            (process,) = pools[-1].processes
            os.kill(process.pid, signal.SIGKILL)
            process.join()

    outcome = shaping.solve(q, 40, workers=2, progress=kill)
    assert outcome.statistics.stopped is None
    assert outcome.statistics.searched == 40
    assert [c.cost for c in outcome.candidates] == [c.cost for c in expected.candidates]
    assert len(pools[-1].processes) == 1


def test_ctrl_c_does_not_reach_the_others_while_they_load(hoap2, pools) -> None:
    """A terminal sends it to all; only this process answers, and theirs do not print a trace."""
    shaping, q = shaping_of(hoap2), hoap2.posture()
    alive: list[bool] = []

    def press(done: int, total: int, cost: float | None) -> None:
        if done == 1:
            (process,) = pools[-1].processes
            os.kill(process.pid, signal.SIGINT)
            process.join(0.3)  # s; time enough to die of it
            alive.append(process.is_alive())

    outcome = shaping.solve(q, 3, workers=2, progress=press)
    assert alive == [True]
    assert outcome.statistics.stopped is None
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_the_others_end_with_the_search(hoap2, pools) -> None:
    shaping_of(hoap2).solve(hoap2.posture(), 3, workers=3)
    (pool,) = pools
    assert len(pool.processes) == 2
    assert not any(process.is_alive() for process in pool.processes)


@pytest.mark.slow
def test_a_script_without_the_guard_is_told_and_answered(tmp_path: Path) -> None:
    """The others load the script again; what they then are asked for is refused by Python."""
    script = tmp_path / "script.py"
    script.write_text(
        "import numpy as np\n"
        "from wbc.shaping import GlobalShaping\n"
        "from wbc.robot import Robot\n"
        "from wbc.tasks import InertiaTask\n"
        "robot = Robot.load('hoap2_like')\n"
        "task = InertiaTask(robot, np.eye(3), frame='base')\n"
        "best = GlobalShaping(robot, [task]).solve(robot.posture(), 250, workers=2).best\n"
        "print('least cost', best.cost)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True)
    assert done.stdout.count("least cost") == 1
    assert "if __name__ == '__main__':" in done.stderr


def test_unusable_numbers_are_refused(hoap2) -> None:
    shaping, q = shaping_of(hoap2), hoap2.posture()
    for name, value, words in (
        ("starts", 0, "must be at least 1"),
        ("workers", 0, "must be at least 1"),
        ("patience", 0, "must be at least 1"),
        ("seconds", 0.0, "must be greater than 0"),
        ("seed", -1, "must be at least 0"),
        ("starts", 2.5, r"expected a whole number, got 2\.5"),
    ):
        with pytest.raises(InvalidInputError, match=f"{name}: {words}"):
            shaping.solve(q, **{name: value})
    with pytest.raises(InvalidInputError, match="shape"):
        shaping.solve(q[:-1])
