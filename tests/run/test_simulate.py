"""Runs without any file, from a start to a result; how they end, and that early ends keep it."""

import math
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc import ComTask, KinematicController, Limits, PostureTask, Robot, support
from wbc.controllers import Tick
from wbc.controllers.closed_loop import ticks_of
from wbc.errors import ControllerFailure, InvalidInputError, UnknownNameError
from wbc.problem import load_problem
from wbc.run import RunStatus, closed_loop, simulate
from wbc.run.stopping import REST_TICKS, RestDetector, Stop, run_status

SMALL = Path(__file__).parents[1] / "problem" / "global_small.yaml"


def controller(robot: Robot) -> KinematicController:
    start = robot.snapshot(robot.posture())
    com = ComTask(robot, start.com - (0.0, 0.0, 0.02), weight=100)
    calm = PostureTask(robot, start.q, weight=1e-2)
    contacts = support(start, "double")
    return KinematicController(robot, [com, calm], contacts=contacts, limits=Limits(robot))


def test_a_controller_runs_to_rest_without_a_file(hoap2: Robot) -> None:
    stop = Stop(duration=5.0, speed=1e-3, accept={"com": 1e-3})
    result = simulate(controller(hoap2), hoap2.posture(), stop, provenance={"made": "here"})
    assert result.status is RunStatus.CONVERGED
    assert result.tasks["com"].norm < 1e-3
    assert result.tasks["com"].units == ("m", "m", "m")
    assert result.provenance == {"made": "here"}
    assert result.summary()["made"] == "here"
    assert set(result.history.support) == {"left,right"}
    assert result.slip is not None
    assert result.slip.value < 5e-4  # m; the target jumps
    assert result.balance is not None
    assert result.balance.value > 0.0


def test_tolerances_of_a_task_that_there_is_not_are_refused_first(hoap2: Robot) -> None:
    with pytest.raises(UnknownNameError, match="unknown task 'con'"):
        simulate(
            controller(hoap2),
            hoap2.posture(),
            Stop(accept={"con": 1e-3}),
            show=lambda *_: pytest.fail("it ran"),
        )


def test_a_run_is_the_loop_tick_by_tick(hoap2: Robot) -> None:
    q = hoap2.posture()
    stop = Stop(duration=0.25, speed=None)
    seen: list[Tick] = []
    result = simulate(controller(hoap2), q, stop, observe=seen.append)
    ticks = list(closed_loop(controller(hoap2), q, 50))
    assert result.status is RunStatus.COMPLETED
    assert len(result.history) == len(ticks) == len(seen) == 50
    np.testing.assert_array_equal(result.history.q, [one.snapshot.q for one in ticks])
    np.testing.assert_array_equal(result.history.v, [one.tick.velocity for one in ticks])
    np.testing.assert_array_equal(result.q, ticks[-1].q)
    np.testing.assert_allclose([one.time for one in ticks], 0.005 * np.arange(50))


def test_an_update_chooses_the_controller_and_ends_the_loop(hoap2: Robot) -> None:
    first, second = controller(hoap2), controller(hoap2)
    second.tasks[0].target = second.tasks[0].target + (0.0, 0.0, 0.02)  # where the CoM is
    chosen = [first, first, second, None]
    ticks = list(closed_loop(first, hoap2.posture(), 99, lambda k, _: chosen[k]))
    assert len(ticks) == 3
    assert ticks[1].speed > 1e-3
    assert ticks[2].tick.velocity[2] > 0.0  # back up
    slower = KinematicController(hoap2, first.tasks, contacts=(), dt=0.01)
    with pytest.raises(InvalidInputError, match=r"ticks last 0\.005 s, .* for 0\.01 s"):
        next(closed_loop(first, hoap2.posture(), 99, lambda k, _: slower))


def test_ticks_are_timed_by_the_clock_and_by_the_threads_own(hoap2: Robot, monkeypatch) -> None:
    """With clocks that go on by 3 s and by 0.5 s whenever they are read."""
    for name, start, step in (("perf_counter", 100.0, 3.0), ("thread_time", 7.0, 0.5)):
        readings = count(start, step)
        monkeypatch.setattr(f"wbc.controllers.closed_loop.{name}", lambda own=readings: next(own))
    ticks = list(closed_loop(controller(hoap2), hoap2.posture(), 3))
    assert [(one.seconds, one.cpu_seconds) for one in ticks] == [(3.0, 0.5)] * 3


def test_a_part_of_a_tick_is_a_tick_but_for_rounding() -> None:
    assert 0.035 / 0.005 > 7.0
    durations = (0.0, 1e-6, 0.005, 0.035, 0.035 + 1e-7, 0.0351)
    assert [ticks_of(one, 0.005) for one in durations] == [0, 1, 1, 7, 8, 8]


def test_a_controller_that_gives_up_ends_the_loop_with_its_tick(hoap2: Robot, monkeypatch) -> None:
    """A failure of what is no tick of this loop is not hidden."""
    one, honest, given = controller(hoap2), KinematicController.step, []

    def step(self, snapshot):
        given.append(honest(self, snapshot))
        if len(given) == 3:
            raise ControllerFailure("enough", given[-1])
        if len(given) == 4:
            raise ControllerFailure("of another kind", None)
        return given[-1]

    monkeypatch.setattr(KinematicController, "step", step)
    ticks = list(closed_loop(one, hoap2.posture(), 9))
    assert [tick.gave_up for tick in ticks] == [False, False, True]
    assert ticks[-1].tick is given[-1]
    with pytest.raises(ControllerFailure, match="of another kind"):
        list(closed_loop(one, hoap2.posture(), 9))


@pytest.mark.slow
def test_on_the_way_to_the_best_posture_the_search_is_kept() -> None:
    asked = count(1)
    ended = load_problem(SMALL).run(cancelled=lambda: next(asked) >= 15)
    assert ended.status is RunStatus.INTERRUPTED
    assert len(ended.history) == 15
    assert ended.shaping is not None
    assert ended.shaping.postures[0].tried == "interrupted"
    assert all(one.tried is None for one in ended.shaping.postures[1:])
    assert ended.reason.startswith("at 0.15 s of at most")


def test_rest_needs_ten_slow_solved_ticks_after_the_ramps() -> None:
    watch = RestDetector(speed=0.1, ramps_end=1.0)
    assert not any(watch.at_rest(0.5, 0.0, True) for _ in range(50))
    assert not any(watch.at_rest(1.0, 0.0, False) for _ in range(50))
    assert not any(watch.at_rest(1.0, 0.2, True) for _ in range(50))
    assert [watch.at_rest(1.0, 0.05, True) for _ in range(REST_TICKS)] == [False] * 9 + [True]
    never = RestDetector(speed=None, ramps_end=0.0)
    assert not any(never.at_rest(9.0, 0.0, True) for _ in range(50))


@pytest.mark.parametrize(("stop", "at_rest", "failed", "error", "status", "words"), [
    ({}, True, 0, 9.0, "converged", "at rest"),
    ({}, False, 0, 9.0, "timeout", "still moving after 20 s"),
    ({"speed": None}, False, 0, 9.0, "completed", "ran for 20 s"),
    ({"accept": {"t": 1.0}}, True, 0, 0.5, "converged", "every tolerance met"),
    ({"accept": {"t": 1.0}}, False, 0, 0.5, "accepted", "still moving"),
    ({"accept": {"t": 1.0}}, True, 0, 2.0, "not_reached", "t (error 2, tolerance 1)"),
    ({"accept": {"t": 1.0}}, False, 0, 2.0, "not_reached", "still moving after 20 s"),
    ({"accept": {"t": 1.0}}, True, 0, float("nan"), "not_reached", "error nan"),
    ({"accept": {"t": 1.0}}, True, 3, 0.5, "qp_failed", "3 of 9 ticks"),
])  # fmt: skip
def test_what_an_end_is_called(stop, at_rest, failed, error, status, words) -> None:
    ended, reason = run_status(Stop(**stop), at_rest, failed, 9, {"t": error})
    assert ended.value == status
    assert words in reason
    assert ended.good == (status in ("converged", "accepted", "completed"))


@pytest.mark.parametrize(
    "given",
    [{"duration": math.nan}, {"duration": -1.0}, {"speed": "slow"}, {"margins": math.inf},
     {"accept": 0.1}, {"accept": {"com": math.nan}}],
)  # fmt: skip
def test_what_no_run_can_end_by_is_refused(given: dict[str, Any]) -> None:
    with pytest.raises(InvalidInputError, match=f"stop, {next(iter(given))}"):
        Stop(**given)
    Stop(duration=0.0, speed=None, balance=None, slip=None, margins=None)
