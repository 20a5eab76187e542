"""Exit codes, and the package's own errors and notes as one line each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from wbc.errors import WbcError

if TYPE_CHECKING:
    from wbc.robot import Robot

BAD_INPUT, NOT_REACHED, QP_FAILED, INTERRUPTED = 1, 3, 4, 130


@contextmanager
def errors_in_one_line() -> Iterator[None]:
    """Turn the package's own errors into a message and an exit code; others are bugs."""
    try:
        yield
    except WbcError as error:
        complain(str(error))
        raise typer.Exit(BAD_INPUT) from None
    except KeyboardInterrupt:
        complain("interrupted")
        raise typer.Exit(INTERRUPTED) from None


def complain(text: str) -> None:
    """Print an error to stderr."""
    head = typer.style("error:", fg="red", bold=True)
    typer.echo(f"{head} {text}", err=True)


def print_notes(robot: Robot) -> None:
    """Print to stderr what was tolerated while a robot was loaded."""
    head = typer.style("note:", fg="yellow", bold=True)
    for note in robot.notes:
        typer.echo(f"{head} {robot.name}: {note}", err=True)
