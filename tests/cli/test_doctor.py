"""``wbc doctor`` says which path runs, and why."""

import pytest
from typer.testing import CliRunner

from tests.needs import needs_core
from wbc.cli import app
from wbc.native import VARIABLE, library


@pytest.fixture(autouse=True)
def _fresh():
    yield
    library._loaded.cache_clear()


def said(code: int = 0) -> str:
    answer = CliRunner().invoke(app, ["doctor"])
    assert answer.exit_code == code, answer.output
    return answer.output


@needs_core
def test_the_core_runs(monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, "auto")
    text = said()
    assert "ticks: native core, WBC_NATIVE=auto: loaded from" in text
    assert "against Pinocchio on hoap2_like: " in text
    assert "pin 4" in text


def test_python_runs_and_why(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(library, "SHIPPED", tmp_path)  # no core that an installation brought
    monkeypatch.setenv("CC", "/no/such/compiler")
    library._loaded.cache_clear()
    for mode, also in (("auto", ""), ("require", "robots cannot be used")):
        monkeypatch.setenv(VARIABLE, mode)
        text = said()
        assert f"ticks: Python, WBC_NATIVE={mode}: CC='/no/such/compiler' is not found" in text
        assert also in text


def test_a_misspelt_mode(monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, "on")
    answer = CliRunner().invoke(app, ["doctor"])
    assert answer.exit_code == 1
    assert "unknown value of WBC_NATIVE 'on'" in answer.stderr
