"""Progress, and what a command does before it has any, is said where somebody waits."""

import io
import logging

import pytest
from rich.console import Console

from wbc.cli import progress
from wbc.cli.progress import DOING, starting
from wbc.simulation import PushOutcome

PUSH = PushOutcome(1.5707963, 1.2, 10.0, True, "stood", 4.0, 0.1, 0.0, 0.0)
CALLS = (
    ((3, 12, {"cost": None}), "start 3 of at most 12: no posture yet", "3 of 12 starts"),
    ((4, 12, {"cost": 0.5}), "start 4 of at most 12: best cost 0.5", "best cost 0.5"),
    ((7, 90, {"time": 0.07, "speed": 0.25, "failed": 2}),
     "tick 7 of at most 90: t = 0.07 s, speed 2.5e-01, 2 failed",
     "t = 0.07 s, speed 2.5e-01, 2 failed"),
    ((7, 90, {"time": 0.07, "failed": 0, "relaxed": 2}),
     "tick 7 of at most 90: t = 0.07 s, 2 relaxed", "t = 0.07 s, 2 relaxed"),
    ((6, 20, {"push": PUSH, "new": 4, "left": 14, "seconds": 60.0}),
     "push 6 of at most 20: 1.2 at 90 deg survived, at most 3.5 min left", "at most 3.5 min left"),
    ((500, 1000), "frame 500 of 1000", "500 of 1000 frames"),
)  # fmt: skip


@pytest.fixture
def terminal(monkeypatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")


def said(quiet: bool = False) -> None:
    with starting("loading p.yaml", quiet):
        logging.getLogger(DOING).info("fitting shapes to the meshes of %s", "g1")


def test_what_is_done_is_said_as_it_comes(terminal, capfd) -> None:
    said()
    told = capfd.readouterr()
    assert told.out == ""
    assert "fitting shapes to the meshes of g1 ..." in told.err
    assert not logging.getLogger(DOING).handlers and logging.getLogger(DOING).propagate


def test_what_is_quiet_says_nothing(terminal, capfd) -> None:
    said(quiet=True)
    assert capfd.readouterr() == ("", "")


def test_where_nobody_waits_nothing_is_said(capfd) -> None:
    said()
    assert capfd.readouterr() == ("", "")


def test_one_that_fails_leaves_nothing_behind(terminal) -> None:
    with pytest.raises(ValueError, match="no"), starting("loading"):
        raise ValueError("no")
    assert not logging.getLogger(DOING).handlers


@pytest.mark.parametrize(("call", "line", "state"), CALLS)
@pytest.mark.parametrize("terminal", [False, True])
def test_what_is_shown(monkeypatch, terminal, call, line, state) -> None:
    text = io.StringIO()
    console = Console(file=text, force_terminal=terminal, width=100, highlight=False)
    monkeypatch.setattr(progress, "plain_console", lambda **_: console)
    monkeypatch.setattr(progress, "SECONDS_BETWEEN_LINES", -1.0)
    with progress.shown_progress() as show:
        show(*call)
    if terminal:
        assert state in text.getvalue()
    else:
        assert text.getvalue() == f"{line}\n"
