"""The benchmark of bodies that are thrown at each other."""

import pytest
import thrown


@pytest.mark.slow
def test_rows_for_few_pairs_keep_all_pairs_of_a_fast_robot() -> None:
    """Hundreds were broken, by decimetres, when only the 25 nearest had rows."""
    row = thrown.thrown("g1", "nothing", 25, 150, 0).split()
    broken, worst = int(row[6]), float(row[7])
    assert broken <= 5 and worst < 0.5


@pytest.mark.slow
def test_bodies_on_short_levers_outweigh_tasks() -> None:
    """Where a hand moves 3 cm by a radian, a task pushed it 15 mm into others."""
    row = thrown.thrown("hoap2_like", "nothing", 25, 120, 1).split()
    broken, worst = int(row[6]), float(row[7])
    assert broken <= 5 and worst < 0.5


@pytest.mark.slow
def test_rows_for_few_pairs_keep_fast_arms_off_obstacles() -> None:
    """Hands went 47 mm into balls, and feet slipped, when only the 5 nearest had rows."""
    row = thrown.thrown("g1", "balls", 5, 150, 2).split()
    broken, worst, slipped = int(row[6]), float(row[7]), float(row[-1])
    assert broken == 0 and worst == 0.0 and slipped < 1.0
