"""Patience in a problem file: the search ends, says why, and the motion follows as ever."""

from pathlib import Path

import pytest

from wbc.cli.printing import search_rows
from wbc.errors import WbcError
from wbc.problem import RunStatus, load_problem

TEXT = Path(__file__).with_name("global_small.yaml").read_text()


def test_patience_ends_the_search_and_is_told(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text(TEXT)
    every = load_problem(file).run()
    assert every.shaping is not None
    assert every.shaping.effort.stopped is None
    result = load_problem(file, {"controller.starts": 60, "controller.patience": 3}).run()
    assert result.status is RunStatus.CONVERGED
    assert result.shaping is not None
    effort = result.shaping.effort
    assert effort.stopped == "settled"
    assert 4 <= effort.searched < 60
    # What settled it is that the last three gained less than 0.1 %.
    costs = {k: one.cost for one in result.shaping.postures for k in one.starts}
    last = max(costs)
    before = min(cost for k, cost in costs.items() if k <= last - 3)
    assert min(costs.values()) >= 0.999 * before
    told = dict(search_rows(result.shaping))
    assert "of 60 starts" in told["search"]
    assert "stopped when nothing better was found" in told["search"]
    with pytest.raises(WbcError, match="patience"):
        load_problem(file, {"controller.patience": 0})
