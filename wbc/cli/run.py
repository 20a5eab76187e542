"""``wbc run``: a problem, run, printed, written and drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.errors import errors_in_one_line, print_notes
from wbc.cli.options import (
    Assign,
    Output,
    Quiet,
    Show,
    Solver,
    ViewFrom,
    Watched,
    check_view,
    overrides_of,
)
from wbc.cli.running import Ended, Wanted, exit_code, finish

if TYPE_CHECKING:
    from wbc.cli.interrupts import Interrupts
    from wbc.problem import Problem, Result
    from wbc.problem.pendulum.problem import PendulumProblem
    from wbc.problem.pendulum.result import PendulumResult
    from wbc.view.live.watching import Watching

EXIT_CODES = (
    "Exit codes: 0 solved; 1 bad input; 2 wrong usage; 3 not at rest or a tolerance not met in"
    " time, or balance, contacts or margins not kept; 4 a QP failed; 130 or 143 ended by Ctrl-C or"
    " SIGTERM, with what was computed until then written."
)


def run(
    problem: Annotated[
        Path,
        typer.Argument(help="The problem file; - reads it from stdin.", metavar="PROBLEM.yaml"),
    ],
    output: Output = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the run into a picture.")] = None,
    view_from: ViewFrom = "front-left",
    show: Show = "all",
    solver: Solver = None,
    assign: Assign = None,
    quiet: Quiet = False,
    view: Watched = False,
) -> None:
    """Run a problem and say what came of it."""
    with errors_in_one_line():
        check_view(view_from, show)
        wanted = Wanted(problem, output or [], plot, quiet, view)
        wanted.check()
        code = _solve(wanted, (view_from, show), overrides_of(assign, solver))
    raise typer.Exit(code)


def _solve(wanted: Wanted, look: tuple[str, str], overrides: dict[str, Any]) -> int:
    """Run a problem, write and print what came of it, and return the exit code."""
    from wbc.cli.outputs import draw_result
    from wbc.cli.printing import print_pendulum_result, print_result
    from wbc.problem import Problem, Result, load_problem

    problem = load_problem(wanted.path, overrides)
    if isinstance(problem, Problem) and not wanted.quiet:
        print_notes(problem.parts.robot)
    watching = wanted.watching(problem)
    result, interrupts = _run(problem, wanted.quiet, watching)
    interrupted = interrupts() or _search_interrupted(result)
    ended = Ended(
        save=result.save,
        draw=lambda path: draw_result(result, path, wanted.name, *look),
        tell=lambda written: (
            print_result(result, written)
            if isinstance(result, Result)
            else print_pendulum_result(result, written)
        ),
        code=exit_code(result.status),
        interrupted=interrupts.exit_code if interrupted else None,
        history=result.history if isinstance(result, Result) else None,
    )
    return finish(wanted, ended, watching)


def _run(
    problem: Problem | PendulumProblem, quiet: bool, watching: Watching | None
) -> tuple[Result | PendulumResult, Interrupts]:
    """Run a problem, until its end or a signal."""
    from wbc.cli.interrupts import Interrupts, noted_interrupts
    from wbc.cli.progress import shown_progress
    from wbc.problem import Problem

    with shown_progress(quiet) as progress:
        if not isinstance(problem, Problem) and problem.spec.plan is not None:
            return problem.run(progress), Interrupts()  # nothing to keep until it is done
        with noted_interrupts() as interrupts:
            if watching is not None and isinstance(problem, Problem):
                return problem.run(progress, cancelled=interrupts, show=watching.show), interrupts
            return problem.run(progress, cancelled=interrupts), interrupts


def _search_interrupted(result: Result | PendulumResult) -> bool:
    """Return whether Ctrl-C ended the search over postures, which listens for it itself."""
    shaping = getattr(result, "shaping", None)
    return shaping is not None and shaping.effort.stopped == "interrupted"
