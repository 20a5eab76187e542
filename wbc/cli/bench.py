"""``wbc bench`` of a clone of the repository: the command lives beside the other benchmarks."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

FOLDER = Path(__file__).parents[2] / "benchmarks"


def add_bench(app: typer.Typer) -> None:
    """Add the command: to measure, or without a clone to say where it is."""
    if (FOLDER / "qpbench" / "command.py").is_file():
        sys.path.append(str(FOLDER))
        from qpbench.command import BENCH_EXIT_CODES, bench

        app.command(epilog=BENCH_EXIT_CODES)(bench)
    else:
        app.command("bench", context_settings={"ignore_unknown_options": True})(without_clone)


def without_clone(
    arguments: Annotated[list[str] | None, typer.Argument(help="Not read here.")] = None,
) -> None:
    """Measure QP solvers on the QPs of controllers: in a clone of the repository."""
    from wbc.errors import InvalidInputError

    raise InvalidInputError(
        "wbc bench: the benchmarks are no part of the installed package; clone the repository,"
        " call make test there once, then .venv/bin/wbc bench"
    )
