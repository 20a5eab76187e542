"""When a run is at rest, and what its end is called."""

import math
from typing import Any

import pytest

from wbc.errors import InvalidInputError
from wbc.run.stopping import REST_TICKS, RestDetector, Stop, run_status


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
def test_what_an_end_is_called(
    stop: dict[str, Any], at_rest: bool, failed: int, error: float, status: str, words: str
) -> None:
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
