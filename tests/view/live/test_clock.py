"""The clock: pace, pause, steps and restart, by a wall clock that the test holds."""

import math

import pytest

from wbc.errors import InvalidInputError
from wbc.view.live import clock as module
from wbc.view.live.clock import MOST_DELAY, Clock
from wbc.view.live.messages import Play, Release, Restart, Speed, StepRequest


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
