"""What a command does before it has anything to show is said where somebody waits."""

import logging

import pytest

from wbc.cli.progress import DOING, starting


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
