"""The verdict on a change: noise and drift do not fool it, and a real change does not hide."""

import copy
from typing import Any

import numpy as np
import pytest
from qpbench.compare import SpeedVerdict, compare


def figures(
    seed: int, slower: float = 1.0, passes: int = 5, success: float = 1.0
) -> dict[str, Any]:
    """Return what wbc bench would write on a noisy machine of a speed of its own."""
    rng = np.random.default_rng(seed)
    speed = np.exp(0.3 * rng.standard_normal())
    drift = np.exp(0.1 * rng.standard_normal(passes).cumsum())
    sequences = {}
    for name, time in (("smooth", 1e-4), ("hard", 4e-4)):
        noise = np.exp(0.02 * rng.standard_normal((2, passes)))
        sequences[name] = {
            "success": success, "QPs": 100, "median": time,
            "passes": (time * slower * speed * drift * noise[0]).tolist(),
            "reference": (1e-3 * speed * drift * noise[1]).tolist(),
        }  # fmt: skip
    return {
        "machine": "this",
        "sequences": {name: {"digest": name} for name in sequences},
        "accuracies": {"1e-06": {"solvers": {"daqp": {"sequences": sequences}}}},
    }


def verdicts(slower: float, seeds: int) -> list[SpeedVerdict]:
    found = []
    for seed in range(seeds):
        (change,), notes = compare(figures(2 * seed), figures(2 * seed + 1, slower))
        assert not notes
        found.append(change.verdict)
    return found


def test_the_same_solver_is_never_called_slower_or_faster() -> None:
    assert verdicts(1.0, 300) == [SpeedVerdict.SAME] * 300


def test_a_change_that_nobody_should_act_upon_is_none() -> None:
    assert set(verdicts(1.03, 100)) == {SpeedVerdict.SAME}


@pytest.mark.parametrize(
    ("slower", "told"), [(1.3, SpeedVerdict.SLOWER), (0.77, SpeedVerdict.FASTER)]
)
def test_a_real_change_is_found(slower: float, told: SpeedVerdict) -> None:
    found = verdicts(slower, 100)
    assert set(found) <= {told, SpeedVerdict.SAME} and found.count(told) >= 99


def test_the_interval_holds_the_true_ratio() -> None:
    """It is two-sided at 99.8 %: at most a few of 500 miss it."""
    missed = 0
    for seed in range(500):
        (change,), _ = compare(figures(2 * seed), figures(2 * seed + 1, 1.2))
        missed += not change.low <= 1.2 <= change.high
    assert missed <= 5


def test_lost_answers_count_more_than_time() -> None:
    (worse,), _ = compare(figures(0), figures(1, 0.5, success=0.97))
    assert worse.verdict is SpeedVerdict.FAILS_MORE and worse.success == (1.0, 0.97)
    (better,), _ = compare(figures(0, success=0.97), figures(1))
    assert better.verdict is SpeedVerdict.FAILS_LESS


def test_too_few_passes_give_no_verdict() -> None:
    (change,), _ = compare(figures(0, passes=2), figures(1, 3.0))
    assert (
        change.verdict is SpeedVerdict.UNKNOWN
        and "needs 3 passes each, has 2 and 5" in change.reason
    )


def test_only_the_same_qps_are_compared_and_the_rest_is_said() -> None:
    old, new = figures(0), figures(1)
    new["sequences"]["hard"]["digest"] = "others"
    new["machine"] = "that"
    new["accuracies"]["1e-06"]["solvers"]["new"] = copy.deepcopy(
        new["accuracies"]["1e-06"]["solvers"]["daqp"]
    )
    (change,), notes = compare(old, new)
    assert change.solver == "daqp"
    told = " ".join(notes)
    assert "another machine" in told and "'hard' has other QPs" in told and "'new'" in told
    del new["sequences"]["smooth"]
    changes, notes = compare(old, new)
    assert not changes and "'smooth' is gone" in " ".join(notes)
