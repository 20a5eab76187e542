"""Exit codes, and the package's own errors and notes as one line each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from wbc.errors import WbcError, listed

if TYPE_CHECKING:
    from wbc.robot import Robot

SHOWN = 6  # joints that are named
BAD_INPUT, NOT_REACHED, QP_FAILED, INTERRUPTED, TERMINATED = 1, 3, 4, 130, 143


@contextmanager
def errors_in_one_line() -> Iterator[None]:
    """Turn the package's own errors, and what the system refuses, into a message and an exit code.

    Others are bugs.
    """
    try:
        yield
    except WbcError as error:
        complain(str(error))
        raise typer.Exit(BAD_INPUT) from None
    except BrokenPipeError:  # who reads what is printed has enough: typer ends quietly
        raise
    except OSError as error:  # a full disk, a read-only folder, a missing one
        complain(refused(error))
        raise typer.Exit(BAD_INPUT) from None
    except KeyboardInterrupt:
        complain("interrupted")
        raise typer.Exit(INTERRUPTED) from None


def refused(error: OSError) -> str:
    """Return what the system refused, in words: a file where it names one, else what is printed."""
    from wbc.files import why

    return f"{error.filename or 'the system refuses'}: {why(error)}"


def complain(text: str) -> None:
    """Print an error to stderr."""
    head = typer.style("error:", fg="red", bold=True)
    typer.echo(f"{head} {text}", err=True)


def print_note(text: str) -> None:
    """Print a note to stderr."""
    head = typer.style("note:", fg="yellow", bold=True)
    typer.echo(f"{head} {text}", err=True)


def print_notes(robot: Robot) -> None:
    """Print to stderr what was tolerated while a robot was loaded, and the limits that it lacks."""
    missing = missing_limits(robot)
    lacks = (f"joints without a limit: {missing}",) if missing else ()
    for note in (*robot.notes, *lacks):
        print_note(f"{robot.name}: {note}")


def missing_limits(robot: Robot) -> str:
    """Return which limits the robot's files do not give, by kind; empty if they give all."""
    joints: dict[str, list[str]] = {}
    for entry in robot.limits.missing:  # such as "left_knee: velocity"
        name, _, kind = entry.rpartition(": ")
        if kind == "effort" and name in robot.unactuated:
            continue  # it has no motor
        joints.setdefault(kind, []).append(name)
    told = []
    for kind, names in joints.items():
        count = len(robot.joint_names)
        all_of_them = f"all {count} joints" if len(names) == count > SHOWN else None
        told.append(f"{kind} ({all_of_them or listed(names, SHOWN)})")
    return "; ".join(told)
