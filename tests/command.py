"""The command line of this process, as a user calls it and ends it."""

import signal

import pytest
from typer.testing import CliRunner, Result

from wbc.cli import app


def wbc_command(*arguments: object, stdin: str | None = None) -> Result:
    """Return what ``wbc`` with these arguments answers."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments], input=stdin)


def signalling(
    monkeypatch: pytest.MonkeyPatch, kind: type, method: str, at: int, number: int = signal.SIGINT
) -> list[tuple[object, ...]]:
    """Let a method of a class send a signal to this process when it is called the ``at``-th time.

    Return the list of its calls' arguments, as they come.
    """
    original, calls = getattr(kind, method), list[tuple[object, ...]]()

    def with_signal(*arguments: object, **named: object) -> object:
        calls.append(arguments)
        if len(calls) == at:
            signal.raise_signal(number)
        return original(*arguments, **named)

    monkeypatch.setattr(kind, method, with_signal)
    return calls
