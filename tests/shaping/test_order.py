"""In which order searches are made and go on: scripted, without IPOPT."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from wbc.constraints import Limits, SelfCollision
from wbc.robot import Robot
from wbc.shaping import multi_start as module
from wbc.shaping.multi_start import LAG, SPREAD, MultiStart
from wbc.shaping.nlp import BuiltNlp, Local, Start, build_nlp
from wbc.shaping.outcome import Candidate, Kept, Rejected, Stopped
from wbc.shaping.problem import ShapingProblem
from wbc.shaping.separation import LATE, ROUNDS, SeparatedIpopt, searcher
from wbc.tasks import InertiaTask


@pytest.fixture
def robot(robot_named) -> Robot:
    return robot_named("hoap2_like")


def built_of(robot: Robot, *constraints: SelfCollision, limit: float | None = None) -> BuiltNlp:
    task = InertiaTask(robot, np.eye(3), frame="base", per_mass=True)
    return build_nlp(ShapingProblem(robot, (task,), (), Limits(robot), constraints), limit)


@cache
def apart(robot: Robot, limit: float | None) -> BuiltNlp:
    return built_of(robot, SelfCollision(robot), limit=limit)


@pytest.mark.parametrize("total", [3, SPREAD, SPREAD + 1, 60])
def test_hops_know_the_results_before_the_last_few(robot, monkeypatch, total: int) -> None:
    """A hop of number n is made when n - LAG starts have a result, and looks at just these."""
    costs = np.random.default_rng(1).permutation(100) + 1.0
    kept = Kept(0.0, 1.0, None, None, ())
    q = robot.posture()

    def evaluate(built, number: int, start: Start, local: Local) -> Candidate | Rejected:
        if number % 7 == 3:
            return Rejected(number, "no", "no")
        place = robot.integrate(q, np.r_[np.zeros(6), np.full(robot.nv - 6, 0.06 * number)], 1.0)
        return Candidate(place, costs[number], {}, kept, "ok", True, 1, (number,))

    looked: dict[int, list[float]] = {}

    def start(self, number: int, elite) -> Start:
        looked[number] = [one.cost for one in elite]
        return multi._built.start(q)

    monkeypatch.setattr(module, "evaluate", evaluate)
    monkeypatch.setattr(module.BasinHopping, "start", start)
    told: list[tuple] = []
    multi = MultiStart(built_of(robot), q, total, None, 0, lambda *news: told.append(news))
    first = len(multi.next_starts())
    assert first == min(total, SPREAD) and multi.drawn == 8 * (first - 1)
    assert not multi.next_starts(), "none twice"
    done, made = 0, first
    while done < made:
        multi.record(done, Local(np.zeros(1), "ok", True, 1))
        done += 1
        made += len(multi.next_starts())
        assert made == min(total, max(first, done + LAG + 1))
    assert made == total and sorted(looked) == list(range(SPREAD, total))
    for number, elite in looked.items():
        known = [costs[k] for k in range(max(0, number - LAG)) if k % 7 != 3]
        assert elite == sorted(known)[:8]
    good = [costs[k] for k in range(total) if k % 7 != 3]
    assert told == [
        (k + 1, total, min(costs[j] for j in range(k + 1) if j % 7 != 3)) for k in range(total)
    ]
    assert [one.cost for one in multi.candidates()] == sorted(good)
    assert [one.start for one in multi.rejected()] == [k for k in range(total) if k % 7 == 3]
    assert multi.reason is None and multi.needs(total)


@pytest.mark.parametrize(("rounds", "limit", "expected"), [
    (0, None, "F"), (1, None, "FfR"), (2, None, "FfRR"), (3, None, "FfRtRR"),
    (99, None, "Ff" + "R" * ROUNDS), (2, 1e-9, "F"),
])  # fmt: skip
def test_searches_go_on_until_no_pair_is_too_near(robot, rounds, limit, expected) -> None:
    """F the first answer, f from a free place, t back from one that is no optimum, R a round."""
    built = apart(robot, limit)
    search = searcher(built.nlp)
    assert isinstance(search, SeparatedIpopt)
    start = built.start(robot.posture())
    log: list[str] = []

    def local(k: int) -> Local:
        return Local(np.full(start.x.size, float(k)), "ok", not (rounds == 3 and k == 1), 10 + k)

    def note(word: str, answer):
        log.append(word)
        return answer

    left = iter([True] * rounds)
    search._first = SimpleNamespace(search=lambda given: note("F", local(0)))  # type: ignore
    search._pairs = SimpleNamespace(grow=lambda x, p: next(left, False), used={1: 2})  # type: ignore
    search._free = lambda given, first: note("f", np.full(3, -1.0))  # type: ignore
    search._retreat = lambda x, p: note("t", (np.full(3, -2.0), 0.5))  # type: ignore
    begun: list[float] = []

    def one_round(given: Start, seconds: float) -> Local:
        assert seconds == np.inf and given.p is start.p
        begun.append(float(given.x[0]))
        return note("R", local(len(begun)))

    search._round = one_round  # type: ignore[method-assign]
    found = search.search(start)
    assert "".join(log) == expected
    count = expected.count("R")
    assert found.iterations == sum(10 + k for k in range(count + 1))
    # Each goes on from the answer before it, or from where that was led to.
    assert begun == [-1.0, -2.0 if rounds == 3 else 1.0, *range(2, 99)][:count]
    assert (found.status == LATE and not found.optimal) == (limit is not None)
    assert search._pairs.used == {}, "each search begins without pairs"


def test_an_answer_that_is_no_number_ends_the_search(robot) -> None:
    built = apart(robot, None)
    search = searcher(built.nlp)
    start = built.start(robot.posture())
    nothing = Local(np.full(start.x.size, np.nan), "Invalid", False, 5)
    search._first = SimpleNamespace(search=lambda given: nothing)  # type: ignore
    assert search.search(start)._replace(x=None) == nothing._replace(x=None)


def test_enough_are_met_ends_it_with_that_reason(robot, monkeypatch) -> None:
    kept = Kept(0.0, 1.0, None, None, ())
    q = robot.posture()
    monkeypatch.setattr(module, "evaluate", lambda built, number, start, local: Candidate(
        q, 0.0, {}, kept, "ok", True, 1, (number,)))  # fmt: skip
    multi = MultiStart(built_of(robot), q, 12, None, 0, None)
    for number in (5, 0, 9):
        multi.record(number, Local(np.zeros(1), "ok", True, 1))
        assert multi.reason is None and multi.needs(11)
    multi.record(2, Local(np.zeros(1), "ok", True, 1))
    assert multi.reason is Stopped.MET and multi.needs(9) and not multi.needs(10)
