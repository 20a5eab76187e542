"""benchmarks/torque_soak.py goes on where it was ended."""

import gc
import sys
from pathlib import Path

import pytest
import torque_soak


@pytest.mark.slow
def test_parts_that_are_kept_are_not_run_again(tmp_path: Path, monkeypatch, capsys) -> None:
    state, ran = tmp_path / "soak.jsonl", []

    def soak(*given):
        ran.append(given)
        return first_soak(*given)

    first_soak = torque_soak.soak
    monkeypatch.setattr(torque_soak, "soak", soak)
    monkeypatch.setattr(torque_soak.gc, "disable", gc.collect)  # other tests need it
    monkeypatch.setattr(torque_soak, "PART", 50)
    monkeypatch.setattr(torque_soak, "EPISODE", 50)

    def lines(ticks: int) -> list[str]:
        command = f"torque_soak --robots hoap2_like --solver active_set --runs 1 --ticks {ticks}"
        monkeypatch.setattr(sys, "argv", [*command.split(), "--state", str(state)])
        torque_soak.main()
        return capsys.readouterr().out.splitlines()

    lines(50)
    with state.open("a") as file:
        file.write('[["hoap2_like", "da')  # as if ended here
    both = lines(100)
    assert len(ran) == 2, "the first part is read, the second is run"
    assert both[0].startswith("hoap2_like active_set: 100 ticks, 0 wrong")
    assert lines(100) == both
    assert len(ran) == 2
