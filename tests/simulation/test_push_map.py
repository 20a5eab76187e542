"""Maps of pushes: limits, what is odd, and files."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import load
from tests.standing import standing
from wbc.simulation import PushGrid, PushMap, PushOutcome
from wbc.simulation.push_bounds import push_bounds
from wbc.simulation.push_map import compare_maps, save_maps

GRID = PushGrid(4, (1.0, 1.2, 1.4, 1.6), failures=0)
# By direction and ratio: a limit, a hole, all survived, nothing survived.
SURVIVED = ("110.", "1101", "1111", "0100")


def outcomes(table: tuple[str, ...]) -> list[PushOutcome]:
    return [
        PushOutcome(float(angle), ratio, ratio, one == "1", "why", 4.0, 0.1, 0.0, 0.0)
        for angle, row in zip(GRID.angles, table, strict=True)
        for ratio, one in zip((1.0, 1.2, 1.4, 1.6), row, strict=True)
        if one != "."
    ]


def made(table: tuple[str, ...]) -> PushMap:
    bounds = push_bounds(standing(load("hoap2_like")), ("left", "right"), GRID.angles, 0.1, 1.2)
    return PushMap("p", "hoap2_like", GRID, outcomes(table), bounds, bounds)


def test_a_limit_is_the_largest_up_to_which_all_were_survived() -> None:
    found = made(SURVIVED)
    np.testing.assert_array_equal(found.limits, [1.2, 1.2, 1.6, 0.0])
    np.testing.assert_array_equal(found.open_ended, [False, False, True, False])
    assert [found.beyond(k) for k in range(4)] == [[], [1.6], [], [1.2]]
    assert not found.complete  # one push was not tried
    assert made(("1100", *SURVIVED[1:])).complete
    first = found.first_failure(1)
    assert first is not None and first.ratio == 1.4
    assert found.first_failure(2) is None


def test_directions_that_were_not_tried_are_not_limits(tmp_path: Path) -> None:
    part = made(("110.", "....", "1...", "...."))
    np.testing.assert_array_equal(part.limits, [1.2, np.nan, 1.0, np.nan])
    np.testing.assert_array_equal(part.tried, [True, False, True, False])
    np.testing.assert_array_equal(part.open_ended, [False, False, True, False])
    assert (part.least, part.mean) == (1.0, pytest.approx(1.1))
    save_maps(tmp_path / "r.json", [part], {})
    (told,) = json.loads((tmp_path / "r.json").read_text())["maps"]
    assert [d["limit"] for d in told["directions"]] == [1.2, None, 1.0, None]
    assert [d["impulse"] is None for d in told["directions"]] == [False, True, False, True]
    assert told["least"] == 1.0
    nothing = made(("....",) * 4)
    assert np.isnan(nothing.least) and np.isnan(nothing.mean)
    assert nothing.summary()["least"] is None


def test_files_hold_what_the_map_says(tmp_path: Path) -> None:
    one, other = made(SURVIVED), made(("1000", "1000", "1110", "1000"))
    for ending in ("json", "npz", "csv"):
        save_maps(tmp_path / f"r.{ending}", [one, other], {"push": {"duration": 0.1}})
    told = json.loads((tmp_path / "r.json").read_text())
    first, second = told["maps"]
    assert [d["limit"] for d in first["directions"]] == [1.2, 1.2, 1.6, 0.0]
    assert first["directions"][1]["survived_beyond"] == [1.6]
    assert first["directions"][2]["at_least"] and first["directions"][2]["first_failure"] is None
    assert len(first["outcomes"]) == 15 and len(second["outcomes"]) == 16
    assert told["compared"]["times"][:3] == pytest.approx([1.2, 1.2, 1.6 / 1.4])
    assert told["compared"]["times"][3] is None  # nothing was survived: nothing is known
    least, mean, _ = compare_maps(one, other)
    assert least == pytest.approx(1.6 / 1.4) and mean == pytest.approx((2.4 + 1.6 / 1.4) / 3)
    nothing = made(("0000",) * 4)
    assert np.isnan(compare_maps(one, nothing)[0])
    with np.load(tmp_path / "r.npz") as archive:
        np.testing.assert_array_equal(archive["survived"][0], [1, 1, 0, -1])
        np.testing.assert_array_equal(archive["2/limit"], [1.0, 1.0, 1.4, 1.0])
        assert np.isnan(archive["time"][0, 3]) and archive["time"][0, 0] == 4.0
    with (tmp_path / "r.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["limit [M omega d]"]) for row in rows] == [1.2, 1.2, 1.6, 0.0]
    assert [row["monotone"] for row in rows] == ["1", "0", "1", "0"]
    assert float(rows[0]["survived [N s]"]) == pytest.approx(1.2 * one.bounds.ankle[0])
