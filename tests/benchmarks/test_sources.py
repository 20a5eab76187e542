"""What was measured with other code is not gone on with."""

import json
import sys
from functools import partial
from pathlib import Path

import pytest
import soak
import torque_soak
import walking
from sources import code_of

from wbc.errors import InvalidInputError
from wbc.journal import Journal


def test_the_code_is_every_source_by_name_and_content(tmp_path: Path) -> None:
    code = partial(code_of.__wrapped__, tmp_path)
    (tmp_path / "gait").mkdir()
    law, rows = tmp_path / "gait" / "law.py", tmp_path / "rows.c"
    law.write_text("gain = 1.0\n")
    rows.write_text("int rows;\n")
    seen = {code()}
    (tmp_path / "law.pyc").write_text("compiled")
    assert code() in seen
    law.write_text("gain = 2.0\n")
    seen.add(code())
    rows.rename(tmp_path / "other.c")
    seen.add(code())
    assert len(seen) == 3


def test_a_journal_of_walks_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "walks.jsonl"
    with Journal(path, walking.MADE_OF):
        pass
    Journal(path, walking.MADE_OF).__exit__(None, None, None)
    with pytest.raises(InvalidInputError, match=r"\(code differs\)"):
        Journal(path, {**walking.MADE_OF, "code": "of before"})


def test_a_soak_is_refused(tmp_path: Path, monkeypatch) -> None:
    """Also one from before codes were kept."""
    monkeypatch.setattr(soak, "RESULTS", tmp_path)
    monkeypatch.setattr(soak, "BACKENDS", ())
    monkeypatch.setattr(sys, "argv", ["soak", "--seed", "4"])
    path = tmp_path / "soak_4.json"
    known = vars(soak.Record(seed=4, code="of before"))
    for kept in (known, {name: known[name] for name in known if name != "code"}):
        path.write_text(text := json.dumps(kept))
        with pytest.raises(SystemExit, match="other code; --fresh"):
            soak.main()
        assert path.read_text() == text


def test_parts_of_a_torque_soak_are_left_aside(tmp_path: Path, monkeypatch, capsys) -> None:
    state, ran = tmp_path / "soak.jsonl", []

    def part(*given) -> torque_soak.Record:
        ran.append(given)
        return torque_soak.Record(ticks=1, timed=[torque_soak.Timed(1e-3, "solved")], once=[1e-3])

    command = "torque_soak --robots hoap2_like --solver active_set --ticks 1 --state"
    monkeypatch.setattr(sys, "argv", [*command.split(), str(state)])
    monkeypatch.setattr(torque_soak, "soak", part)
    monkeypatch.setattr(torque_soak.gc, "disable", lambda: None)  # other tests need it
    for code, runs in (("one", 1), ("one", 1), ("other", 2), ("one", 2)):
        monkeypatch.setattr(torque_soak, "code_of", lambda code=code: code)
        torque_soak.main()
        assert len(ran) == runs
        told = capsys.readouterr().err
        assert ("1 parts of" in told) == (runs == 2)
