"""Processes that call a function: what they answer, and what comes of those that die."""

import logging
import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import resource_tracker
from pathlib import Path

import pytest

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.workers import Death, WorkerAnswer, WorkerDiedError, Workers


@dataclass(frozen=True)
class Deadly:
    """Doubles a number; the process dies of numbers below 0, and of 7 for the first time."""

    marker: Path

    def __call__(self) -> Callable[[int], int]:
        return self.doubled

    def doubled(self, number: int) -> int:
        first = number == 7 and not self.marker.exists()
        if first:
            self.marker.touch()
        if number < 0 or first:
            os.kill(os.getpid(), signal.SIGKILL)
        if number == 5:
            raise UnknownNameError("number", "five", ["four", "six"])
        return 2 * number


def refused() -> Callable[[int], int]:
    raise InvalidInputError("nothing can be doubled here")


def warned(number: int) -> int:
    logging.getLogger("wbc.robot").warning("%s of the file", "a note", extra={"noted": True})
    logging.getLogger("wbc.controllers").warning("%s is in mm?", "the target")
    return number


def warning() -> Callable[[int], int]:
    return warned


def answers(workers: Workers, numbers: list[int]) -> dict[object, WorkerAnswer]:
    found: dict[object, WorkerAnswer] = {}
    numbers = list(numbers)
    total = len(numbers)
    while len(found) < total:
        while numbers and workers.room:
            workers.submit(numbers[0], numbers.pop(0))
        found |= {answer.key: answer for answer in workers.results(60.0)}
    return found


def test_a_call_that_kills_is_tried_again_and_in_the_end_given_up(tmp_path: Path) -> None:
    deaths: list[Death] = []
    with Workers(Deadly(tmp_path / "marker"), 2, deaths.append, attempts=2) as workers:
        found = answers(workers, [1, 7, 2, -1, 5, 3])
        assert workers.room == 2
    assert {key: found[key].value for key in (1, 2, 3, 7)} == {1: 2, 2: 4, 3: 6, 7: 14}
    assert isinstance(found[-1].error, WorkerDiedError) and "2 times" in str(found[-1].error)
    # An error whose class cannot be made from its text alone still says what it said.
    assert "unknown number 'five'" in str(found[5].error)
    assert [(one.key, one.attempt, one.final) for one in deaths if one.key == -1] == [
        (-1, 1, False), (-1, 2, True)
    ]  # fmt: skip
    assert [(one.attempt, one.final) for one in deaths if one.key == 7] == [(1, False)]
    assert all("SIGKILL" in one.worker and "process" in one.worker for one in deaths)


def test_a_process_that_dies_idle_costs_no_call_an_attempt(tmp_path: Path) -> None:
    deaths: list[Death] = []
    with Workers(Deadly(tmp_path / "marker"), 1, deaths.append, attempts=1) as workers:
        (answer,) = answers(workers, [1]).values()
        pid = int(answer.worker.rpartition(" ")[2])
        os.kill(pid, signal.SIGKILL)
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)  # dead, and not yet reaped
        assert answers(workers, [2])[2].value == 4
    assert [(one.key, one.final) for one in deaths] == [(None, False)]


def test_what_cannot_be_made_is_told_to_whoever_calls() -> None:
    with Workers(refused, 1) as workers:
        (answer,) = answers(workers, [1]).values()
    assert isinstance(answer.error, InvalidInputError)
    assert "nothing can be doubled" in str(answer.error)


def blocks_interrupt() -> Callable[[], bool]:
    return lambda: signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_ctrl_c_does_not_reach_the_first_process_that_is_started() -> None:
    resource_tracker._resource_tracker._stop()  # as nothing was started yet
    with Workers(blocks_interrupt, 1) as workers:
        workers.submit(0)
        assert workers.results(60.0)[0].value is True


def test_what_processes_warn_of_is_logged_here_once(caplog: pytest.LogCaptureFixture) -> None:
    """Each printed it for itself, in every call."""
    with Workers(warning, 2) as workers:
        answers(workers, [1, 2, 3, 4])
    assert [record.getMessage() for record in caplog.records] == ["the target is in mm?"]
