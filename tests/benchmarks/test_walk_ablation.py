"""The table of pushed walks by variants."""

import pytest
import walk_ablation as ablation


def rows(variant: str, *impulses: float) -> list[dict[str, object]]:
    """Two seeds, pushed from the back at two phases."""
    places = [(seed, phase) for seed in (0, 1) for phase in (0, 3)]
    return [
        {"variant": variant, "seed": seed, "side": "back", "phase": phase, "impulse": impulse}
        for (seed, phase), impulse in zip(places, impulses, strict=True)
    ]


def test_means_are_compared_where_all_variants_were_pushed() -> None:
    found = [*rows("regulated", 30.0, 40.0, 34.0, 44.0), *rows("planned", 33.0, 48.0, 37.0, 48.0)]
    alone = {**found[-1], "side": "left", "impulse": 90.0}
    bounds = {"pendulum": {("back", 0): 50.0, ("back", 3): 60.0}}
    lines = ablation.table([*found, alone], bounds).splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert cells[0] == ["pushed", "regulated", "planned", "pendulum"]
    assert [row[0] for row in cells[2:4]] == ["back, 0/4", "back, 3/4"]
    assert [float(one) for one in cells[-2][1:]] == pytest.approx([37.0, 41.5, 55.0])
    assert [float(one) for one in cells[-1][1:]] == pytest.approx([1.0, 1.12, 1.49])
