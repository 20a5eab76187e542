"""Runs that are asked to end early keep what was computed."""

from itertools import count
from pathlib import Path

import pytest

from wbc.problem import load_problem
from wbc.run import RunStatus

SMALL = Path(__file__).parents[1] / "problem" / "global_small.yaml"


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
