"""``wbc replay``: repeat a recorded run or a saved tick, and compare."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.errors import NOT_REACHED, complain
from wbc.cli.options import Quiet

REPLAY_EXIT_CODES = (
    "Exit codes: 0 the same to the last bit, but for times; 1 bad input; 2 wrong usage; 3 not the"
    " same; 130 or 143 ended by Ctrl-C or SIGTERM."
)


def replay(
    file: Annotated[
        Path,
        typer.Argument(
            help="What wbc run or wbc sim wrote (.json, .npz), a log of wbc hardware run, or a tick"
            " that was saved.",
            metavar="FILE",
        ),
    ],
    code: Annotated[
        Path | None,
        typer.Option(
            help="Of a tick: the Python file that defines tasks or constraints of yours; it is run."
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Run a recorded session again, or ask for a saved tick again, and compare to the last bit.

    A tick is saved by wbc run --save-tick, or by tick.save(path).
    """
    from wbc.controllers.tick import TICK_FILE
    from wbc.errors import InvalidInputError
    from wbc.safe_pickle import kind_of

    if kind_of(file) == TICK_FILE:
        same, text = _tick(file, code)
    elif code is not None:
        raise InvalidInputError("--code: only for a saved tick")
    else:
        same, text = _run(file, quiet)
    if not quiet:
        typer.echo(text)
    raise typer.Exit(0 if same else NOT_REACHED)


def _tick(file: Path, code: Path | None) -> tuple[bool, str]:
    from wbc.controllers.saved_tick import SavedTick

    saved = SavedTick.load(file, code)
    written = ", ".join(f"{name} {version}" for name, version in saved.versions.items())
    asked = f"{file}: {saved.controller!r}, by {written}\nanswered  {saved.answer['report']}"
    again = saved.replay()
    same = "the same to the last bit"
    return again.same, f"{asked}\nagain     {same if again.same else '; '.join(again.differences)}"


def _run(file: Path, quiet: bool) -> tuple[bool, str]:
    from wbc.hardware.log_file import is_log
    from wbc.hardware.replay import replay_log

    if file.suffix.lower() == ".npz" and is_log(file):
        log = replay_log(file)
        return log.same, f"{file}: {log}"
    from wbc.cli.interrupts import noted_interrupts
    from wbc.cli.progress import shown_progress
    from wbc.problem.replay import describe_replay, replay_run

    with shown_progress(quiet) as progress, noted_interrupts() as interrupts:
        again = replay_run(file, progress, interrupts)
    if interrupts():
        complain(f"interrupted; {describe_replay(again)}")
        raise typer.Exit(interrupts.exit_code)
    return again.same, f"{file}: {describe_replay(again)}"
