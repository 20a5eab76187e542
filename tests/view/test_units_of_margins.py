"""A tilt's margin is an angle: no table, plot or column calls it a distance."""

from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from tests.texts import CHEAP
from tests.view.reading import plots
from wbc.cli.printing import print_result
from wbc.problem.saved import load_result
from wbc.run import Result
from wbc.view import run_figure
from wbc.view.report.report import report_text

TILTED = f"""{CHEAP}constraints:
  tilt: {{type: tilt, frame: torso, angle: 0.5}}
  balance: {{type: com_support}}
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return problem_of(tmp_path_factory.mktemp("tilt"), TILTED).run()


def test_in_tables(result: Result, capsys: pytest.CaptureFixture[str]) -> None:
    told = result.summary()["constraints"]
    assert {name: one["unit"] for name, one in told.items()} == {"tilt": "rad", "balance": "m"}
    print_result(result, ())
    tilt = told["tilt"]["least_clearance"]
    assert 0.4 < tilt < 0.5
    assert f"tilt  {tilt:.3g} rad".split() == _line_of("tilt", capsys.readouterr().out)[:3]
    page = report_text(result.robot, result.history, result.summary(), "tilted")
    assert f"<td>tilt</td><td>{tilt:.4g} rad</td>" in page
    balance = 1e3 * told["balance"]["least_clearance"]
    assert f"<td>balance</td><td>{balance:.4g}</td>" in page


def _line_of(name: str, text: str) -> list[str]:
    return next(line.split() for line in text.splitlines() if line.startswith(name))


def test_in_files_and_plots(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "r.csv")
    header = (tmp_path / "r.csv").read_text().splitlines()[0]
    assert "constraint/tilt [rad]" in header and "constraint/balance [m]" in header
    result.save(tmp_path / "r.npz")
    saved = load_result(tmp_path / "r.npz")
    for history in (result.history, saved.history):
        axes = plots(run_figure(result.robot, history))["Clearance of the constraints"]
        assert {text.get_text() for text in axes.texts} == {"tilt [rad]", "balance"}
        drawn = [line.get_ydata() for line in axes.lines]
        assert any(np.array_equal(one, history.clearance["tilt"]) for one in drawn)
