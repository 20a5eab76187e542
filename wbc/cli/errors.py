"""Exit codes, and printing errors and notes on one line each, typer's included."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer
from typer.core import TyperGroup

from wbc.errors import WbcError, listed

if TYPE_CHECKING:
    from wbc.robot import Robot

SHOWN = 6  # joints that are named
UsageError: Any = typer.BadParameter.__base__  # typer does not show it
OF_THE_FILE = "values of the file are replaced by --set"
BAD_INPUT, NOT_REACHED, QP_FAILED, INTERRUPTED = 1, 3, 4, 130


@contextmanager
def errors_in_one_line() -> Iterator[None]:
    """Turn the package's and the system's errors into a message and an exit code."""
    try:
        yield
    except WbcError as error:
        complain(str(error))
        raise typer.Exit(BAD_INPUT) from None
    except BrokenPipeError:  # the reader of stdout has ended: typer exits quietly
        raise
    except OSError as error:  # a full disk, a read-only folder, a missing one
        complain(refused(error))
        raise typer.Exit(BAD_INPUT) from None
    except (KeyboardInterrupt, ImportError) as error:
        # Compiled packages that are interrupted while they load make an ImportError of it, or two.
        first: BaseException | None = error
        while isinstance(first, ImportError):
            first = first.__cause__
        if not isinstance(first, KeyboardInterrupt):
            raise
        complain("interrupted")
        raise typer.Exit(INTERRUPTED) from None


def refused(error: OSError) -> str:
    """Return a system error in words, with its file, or standard output if it names none."""
    from wbc.files import system_message

    return f"{error.filename or 'the system refuses'}: {system_message(error)}"


def complain(text: str) -> None:
    """Print an error to stderr."""
    _print_to_stderr("error:", "red", text)


def print_note(text: str) -> None:
    """Print a note to stderr."""
    _print_to_stderr("note:", "yellow", text)


def _print_to_stderr(head: str, colour: str, text: str) -> None:
    """Print a line with a coloured head, unless NO_COLOR forbids it (no-color.org)."""
    plain = False if os.environ.get("NO_COLOR") else None  # None: as it is a terminal or not
    typer.echo(f"{typer.style(head, fg=colour, bold=True)} {text}", err=True, color=plain)


class _Warnings(logging.Handler):
    """Prints what the library warns of, once, unless it is among the notes of a robot or result."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.printed, self.quiet = set[str](), False

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if not (self.quiet or text in self.printed or getattr(record, "noted", False)):
            self.printed.add(text)
            print_note(text)


_WARNINGS = _Warnings()


def print_warnings() -> None:
    """Print to stderr what the library warns of from now on, each warning once."""
    _WARNINGS.printed, _WARNINGS.quiet = set(), False
    logging.getLogger("wbc").addHandler(_WARNINGS)


def warn_unless_quiet(quiet: bool) -> bool:
    """Print no warnings with ``--quiet``."""
    _WARNINGS.quiet = quiet
    return quiet


def print_notes(robot: Robot) -> None:
    """Print to stderr a robot's notes from loading, and its missing limits."""
    missing = missing_limits(robot)
    lacks = (f"joints without a limit: {missing}",) if missing else ()
    for note in (*robot.notes, *lacks):
        print_note(f"{robot.name}: {note}")


def missing_limits(robot: Robot) -> str:
    """Return which limits are missing in the robot's files, by kind; empty if none."""
    joints: dict[str, list[str]] = {}
    for entry in robot.limits.missing:  # such as "left_knee: velocity"
        name, _, kind = entry.rpartition(": ")
        if kind == "effort" and name in robot.motorless:
            continue  # it has no motor
        joints.setdefault(kind, []).append(name)
    told = []
    for kind, names in joints.items():
        count = len(robot.joint_names)
        all_of_them = f"all {count} joints" if len(names) == count > SHOWN else None
        told.append(f"{kind} ({all_of_them or listed(names, SHOWN)})")
    return "; ".join(told)


class Commands(TyperGroup):
    """Commands whose usage errors suggest what to write."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, its paragraphs of help in one line each: lines of sources stay."""
        found = super().get_command(ctx, cmd_name)
        if found is not None and found.help:
            found.help = "\n\n".join(" ".join(one.split()) for one in found.help.split("\n\n"))
        return found

    def invoke(self, ctx: Any) -> Any:
        """Run the command of the line; the package's own errors become a message each.

        Raises UsageError: Typer's own, which typer tells; what to write is in its message.
        """
        with errors_in_one_line():
            try:
                return super().invoke(ctx)
            except UsageError as error:
                if hint := self._hint(error):
                    error.message = f"{error.message.rstrip('.')}; {hint}"
                raise

    def _hint(self, error: Any) -> str:
        """Return a suggestion for a usage error; empty if there is none."""
        if error.ctx is None:  # an option at the end of the line, without its value
            return ""
        command, said, group = error.ctx.command, error.message, error.ctx.parent
        if command is self and (found := re.fullmatch(r"No such command '(.*)'\.", said)):
            word = found[1]
            if word.endswith((".yaml", ".yml")):
                return f"a problem is run by: wbc run {word}, and in physics by: wbc sim {word}"
            nearest = next((name for name in self.commands if word.startswith(name)), None)
            return f"did you mean {nearest!r}?" if nearest else ""
        of_this = group is not None and group.command is self  # not of a group within this one
        if not of_this or not any("--set" in one.opts for one in command.params):
            return ""
        if found := re.match(r"Got unexpected extra argument.*\(([^\s=]+=[^\s)]+)", said):
            return f"{OF_THE_FILE}: --set {found[1]}"
        cut = any("=" not in one for one in error.ctx.params.get("assign") or ())
        if said.startswith("Got unexpected extra") and cut:
            return "--set takes a path and its value as one word, as in --set tasks.com.gain=0.3"
        if said.startswith("No such option") and not getattr(error, "possibilities", None):
            return f"{OF_THE_FILE}, as in --set tasks.com.gain=0.3"
        return ""
