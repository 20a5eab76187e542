"""A session: a problem that runs, is steered and begun again, and the clock that paces it."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from tests.view.live.conftest import client_of, drag
from wbc.errors import InvalidInputError
from wbc.problem import load_problem
from wbc.problem.controller_spec import GlobalSpec
from wbc.problem.problem import Problem
from wbc.robot import Snapshot
from wbc.run.simulate import simulate
from wbc.run.stopping import Stop
from wbc.view.live import clock as module
from wbc.view.live.clock import MOST_DELAY, Clock
from wbc.view.live.messages import Play, Release, Restart, SetTarget, Speed, StepRequest
from wbc.view.live.session import Session, checked
from wbc.view.live.viewer import Viewer

PROBLEMS = Path(__file__).parents[3] / "problems"
FREE = """
robot: hoap2_like
start: {posture: standing}
support: double
tasks:
  com: {type: com, target: {offset: [0, 0.01, 0]}, ramp: 0.5, weight: 10.0}
  posture: {type: posture, target: start, weight: 0.01}
"""


@pytest.fixture
def problem(tmp_path: Path) -> Problem:
    return checked(problem_of(tmp_path, FREE))


@pytest.fixture
def viewer(problem: Problem) -> Iterator[Viewer]:
    with Viewer(problem.parts.robot, quiet=True, clock=True) as made:
        yield made


Seen = list[Snapshot]


@pytest.fixture
def seen(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> Seen:
    """Return what the viewer is given, tick by tick."""
    found, update = Seen(), viewer.update

    def remember(snapshot, *rest, **more):  # type: ignore[no-untyped-def]
        found.append(snapshot)
        update(snapshot, *rest, **more)

    monkeypatch.setattr(viewer, "update", remember)
    return found


def test_without_a_user_it_is_the_run_itself(problem: Problem, viewer: Viewer, seen: Seen) -> None:
    """The same bits as in a run that nobody looks at."""
    Session(problem, viewer, Clock(0.0)).run(100)
    stop = Stop(duration=0.5, speed=None)
    result = simulate(problem.executor(), problem.parts.start, stop)
    np.testing.assert_array_equal([one.q for one in seen], result.history.q)


@pytest.mark.slow
def test_a_dragged_target_is_followed_and_given_back(problem, viewer, seen) -> None:
    """Over the ramp of the file, which moves the same target in every tick."""
    session = Session(problem, viewer, Clock(0.0))
    session.run(1)
    wanted = seen[0].com + [0.0, -0.015, 0.0]
    with client_of(viewer.url) as client:
        for _ in range(100):  # until the page has drawn the handle
            drag(client, "com", wanted)
            viewer.wait_for_user(0.2)
            if viewer.has_wishes:
                break
        session.run(400)
    np.testing.assert_allclose(seen[-1].com, wanted, atol=1e-3)
    assert not viewer.error


@pytest.mark.slow
def test_pages_come_and_go(problem: Problem, viewer: Viewer, seen: Seen) -> None:
    session = Session(problem, viewer, Clock(0.0))
    for _ in range(2):
        with client_of(viewer.url) as one, client_of(viewer.url) as other:
            session.run(30)
            one.close()
            session.run(30)
            assert other.recv(timeout=20.0)
        session.run(30)
    assert session.ticks == 180
    assert not viewer.error


@pytest.mark.slow
def test_pause_and_restart(problem: Problem, viewer: Viewer, seen: Seen) -> None:
    session = Session(problem, viewer, Clock(0.0))
    viewer._requests.append(Restart())  # comes after the first tick
    session.run(5)
    again = simulate(problem.executor(), problem.parts.start, Stop(duration=0.02, speed=None))
    np.testing.assert_array_equal([one.q for one in seen[1:]], again.history.q)
    viewer._requests.append(Play(False))
    viewer._requests.append(Play(True))
    session.run(5)
    assert session.ticks == 10


@pytest.mark.slow
def test_it_ends_with_the_page(problem: Problem, viewer: Viewer) -> None:
    session = Session(problem, viewer, Clock(0.0))
    session.run(1)
    viewer._page._process.kill()
    session.run()  # without end, but for that
    assert "ended" in viewer.error


@pytest.mark.slow
def test_a_refused_target_is_said(problem: Problem, viewer: Viewer) -> None:
    session = Session(problem, viewer, Clock(0.0))
    viewer._wishes.append(SetTarget("com", (np.full(3, np.nan),)))
    session.run(2)
    assert "task 'com', target" in viewer.steering.refusal


def test_problems_without_a_controller_to_steer(problem: Problem) -> None:
    with pytest.raises(InvalidInputError, match="wbc run --plot"):
        checked(load_problem(PROBLEMS / "rmp_swing_up.yaml"))
    searching = problem.spec.model_copy(update={"controller": GlobalSpec.model_construct()})
    with pytest.raises(InvalidInputError, match="wbc run --view"):
        checked(replace(problem, spec=searching))


class Wall:
    """A clock that goes on only while somebody waits."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    held = Wall()
    monkeypatch.setattr(module, "time", held)
    return held


def run(clock: Clock, wall: Wall, ticks: int, dt: float = 0.005, work: float = 0.001) -> float:
    """Return how long so many ticks take, each of which works for a while."""
    began = wall.now
    for _ in range(ticks):
        wall.now += work
        while left := clock.remaining(dt):
            wall.now += left
    return wall.now - began


@pytest.mark.parametrize("speed", [0.5, 1.0, 2.0])
def test_ticks_are_paced(wall: Wall, speed: float) -> None:
    assert run(Clock(speed), wall, 1000) == pytest.approx(1000 * 0.005 / speed, rel=2e-3)


def test_as_fast_as_can_be(wall: Wall) -> None:
    assert run(Clock(0.0), wall, 100) == pytest.approx(100 * 0.001)


def test_a_loop_that_was_held_up_does_not_rush_afterwards(wall: Wall) -> None:
    clock = Clock()
    run(clock, wall, 10)
    wall.now += 10.0 + MOST_DELAY
    assert run(clock, wall, 100) == pytest.approx(0.5, rel=0.02)


def test_pause_step_and_play(wall: Wall) -> None:
    clock = Clock()
    clock.receive(Play(False))
    assert [clock.remaining(0.005) for _ in range(3)] == [math.inf] * 3
    clock.receive(StepRequest())
    clock.receive(StepRequest())
    assert [clock.remaining(0.005) for _ in range(3)] == [0.0, 0.0, math.inf]
    clock.receive(Play(True))
    assert run(clock, wall, 10) == pytest.approx(0.05, rel=0.2)


def test_a_restart_ends_a_pause() -> None:
    clock = Clock()
    clock.receive(Play(False))
    clock.receive(Restart())
    assert clock.restart
    assert clock.playing
    assert clock.remaining(0.005) == 0.0


def test_what_is_no_wish_about_the_clock() -> None:
    with pytest.raises(InvalidInputError, match="must"):
        Clock().receive(Speed(-1.0))
    with pytest.raises(InvalidInputError, match="Release"):
        Clock().receive(Release())  # type: ignore[arg-type]
