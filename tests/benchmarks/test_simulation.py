"""The measurement of the closed loop runs and fills its table."""

from benchmarks.simulation import measure


def test_a_line_of_the_table() -> None:
    cells = [cell.strip() for cell in measure("hoap2_like", "daqp", 0.1).strip("|").split("|")]
    assert cells[:2] == ["hoap2_like", "daqp"] and cells[-1] == "stood for 0.100 s"
    times = [float(cell) for cell in cells[2:9]]
    assert all(time > 0.0 for time in times)
    cpu, physics, ticks, rest = times[1:5]
    assert abs(cpu - physics - ticks - rest) < 0.02  # of which it is the sum, rounded
