"""The benchmark of bodies that are thrown at each other."""

import pytest
import thrown


@pytest.mark.slow
def test_rows_for_few_pairs_keep_all_pairs_of_a_fast_robot() -> None:
    """Hundreds were broken, by decimetres, when only the 25 nearest had rows."""
    row = thrown.thrown("g1", False, 25, 150, 0).split()
    broken, worst = int(row[6]), float(row[7])
    assert broken <= 5 and worst < 0.5
