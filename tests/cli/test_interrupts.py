"""Ctrl-C and SIGTERM: what was computed is kept, and the exit code is the shell's."""

import json
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from typer.testing import Result

from tests.command import signalling, wbc_command
from wbc.cli.errors import errors_in_one_line
from wbc.cli.interrupts import noted_interrupts
from wbc.controllers import Controller
from wbc.rmp.balance.momentum_qp import MomentumQp

LONG = """\
robot: hoap2_like
support: floating
tasks:
  hand: {type: frame, frame: left_hand, control: position, target: {offset: [0, 0, 0.01]}}
stop: {duration: 1000.0, speed: null}
"""
PENDULUM = """\
model: rmp_solid
mass: 35.0
start: {leg_length: 0.7, radii: [0.2, 0.2, 0.2]}
bounds: {polygon: [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]], friction: 0.8,
  wheel_torque: 50.0, wheel_angle: 0.6}
law: {type: momentum_qp}
stop: {duration: 1000.0, dt: 0.002}
"""


@pytest.fixture(autouse=True)
def handlers_are_put_back() -> Iterator[None]:
    both = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in both]
    yield
    assert [signal.getsignal(number) for number in both] == before


def run(folder: Path, text: str, *options: object) -> Result:
    path = folder / "long.yaml"
    path.write_text(text)
    return wbc_command("run", path, *options)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_what_was_computed_is_written(tmp_path, monkeypatch, number, code) -> None:
    signalling(monkeypatch, Controller, "step", 21, number)
    answer = run(tmp_path, LONG, "-o", tmp_path / "r.json")
    assert answer.exit_code == code
    assert "interrupted: at 0.105 s of at most 1000 s" in answer.stdout  # 21 ticks
    assert f"what was computed until then is in {tmp_path / 'r.json'}" in answer.stderr
    summary = json.loads((tmp_path / "r.json").read_text())
    assert (summary["status"], summary["ticks"]) == ("interrupted", 21)


def test_without_an_output_it_is_kept_elsewhere(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    signalling(monkeypatch, Controller, "step", 4)
    answer = run(tmp_path, LONG, "-q")
    (kept,) = tmp_path.glob("wbc-*/long.npz")
    assert answer.stderr == f"error: interrupted; what was computed until then is in {kept}\n"


def test_a_pendulum_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    signalling(monkeypatch, MomentumQp, "command", 51, signal.SIGTERM)
    answer = run(tmp_path, PENDULUM, "-o", tmp_path / "r.json")
    assert answer.exit_code == 143
    assert json.loads((tmp_path / "r.json").read_text())["status"] == "interrupted"


def test_a_second_one_ends_at_once() -> None:
    with noted_interrupts() as noted:
        signal.raise_signal(signal.SIGINT)
        assert noted()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_a_search_hears_of_sigterm_as_of_ctrl_c() -> None:
    """It puts an ear of its own in the place of this one while it searches."""
    heard: list[int] = []
    with noted_interrupts() as noted:
        here = signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
        signal.raise_signal(signal.SIGTERM)
        signal.signal(signal.SIGINT, here)
    assert heard == [signal.SIGINT]
    assert noted()
    assert noted.exit_code == 143


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no terminal that could be gone")
def test_a_terminal_that_is_gone_is_noted_unless_nohup_ignores_it() -> None:
    """As an ssh that broke off: the loop of a robot died at once, and the robot fell."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # tests may run under nohup themselves
    try:
        with noted_interrupts(hangup=True) as noted:
            signal.raise_signal(signal.SIGHUP)
        assert noted() and noted.exit_code == 129
        with noted_interrupts():
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_DFL
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with noted_interrupts(hangup=True) as noted:
            signal.raise_signal(signal.SIGHUP)
        assert not noted()
    finally:
        signal.signal(signal.SIGHUP, before)


def test_ctrl_c_while_a_compiled_package_loads_is_no_traceback(capsys) -> None:
    """Pybind11 makes an ImportError of it: one in 36 of `wbc check` ended so."""
    with pytest.raises(typer.Exit) as ended, errors_in_one_line():
        raise ImportError("initialization failed") from KeyboardInterrupt()
    with pytest.raises(typer.Exit), errors_in_one_line():  # of a package that imports it
        try:
            raise ImportError("initialization failed") from KeyboardInterrupt()
        except ImportError as error:
            raise ImportError("initialization failed") from error
    assert ended.value.exit_code == 130 and "interrupted" in capsys.readouterr().err
    with pytest.raises(ImportError, match="no module"), errors_in_one_line():
        raise ImportError("no module") from None
