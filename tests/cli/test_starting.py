"""What a command does before it has anything to show is said where it takes a while."""

import logging
import threading

import pytest

from wbc.cli import starting as module
from wbc.cli.starting import DOING, starting


@pytest.fixture(autouse=True)
def terminal(monkeypatch) -> None:
    monkeypatch.setattr(module, "is_watched", lambda: True)


def test_what_takes_long_is_said_as_it_comes(monkeypatch, capfd) -> None:
    monkeypatch.setattr(module, "SECONDS", 0.0)
    late = threading.Event()
    monkeypatch.setattr(
        module._Told, "be_late", lambda self, real=module._Told.be_late: (real(self), late.set())
    )
    with starting("loading p.yaml"):
        assert late.wait(10.0)
        logging.getLogger(DOING).info("fitting shapes to the meshes of %s", "g1")
    told = capfd.readouterr()
    assert told.out == ""
    assert told.err == "loading p.yaml ...\nfitting shapes to the meshes of g1 ...\n"


@pytest.mark.parametrize("quiet", [True, False])
def test_what_is_quick_or_quiet_says_nothing(monkeypatch, capfd, quiet: bool) -> None:
    monkeypatch.setattr(module, "SECONDS", 0.0 if quiet else 1000.0)
    with starting("loading p.yaml", quiet):
        logging.getLogger(DOING).info("fitting")
    assert capfd.readouterr() == ("", "")
    logger = logging.getLogger(DOING)
    assert not logger.handlers and logger.propagate
    assert not [one for one in threading.enumerate() if isinstance(one, threading.Timer)
                and not one.finished.is_set()]  # fmt: skip


def test_where_nobody_waits_nothing_is_said(monkeypatch, capfd) -> None:
    monkeypatch.setattr(module, "is_watched", lambda: False)
    monkeypatch.setattr(module, "SECONDS", 0.0)
    with starting("loading p.yaml"):
        logging.getLogger(DOING).info("fitting")
    assert capfd.readouterr() == ("", "")


def test_one_that_fails_leaves_nothing_behind(monkeypatch) -> None:
    monkeypatch.setattr(module, "SECONDS", 1000.0)
    with pytest.raises(ValueError, match="no"), starting("loading"):
        raise ValueError("no")
    assert not logging.getLogger(DOING).handlers
