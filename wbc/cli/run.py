"""``wbc run``: a problem, run, printed, written and drawn."""

from __future__ import annotations

import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.completion import directions_beginning, layers_beginning, solvers_beginning
from wbc.cli.errors import (
    BAD_INPUT,
    NOT_REACHED,
    QP_FAILED,
    complain,
    errors_in_one_line,
    print_notes,
)

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


ViewFrom = Annotated[
    str,
    typer.Option(
        help="In the picture: front, left, top, back-right ...; or azimuth,elevation in degrees.",
        autocompletion=directions_beginning,
    ),
]
Show = Annotated[
    str,
    typer.Option(
        help="Layers of the picture, as in robot,com,targets; or without some: no-ellipsoid.",
        autocompletion=layers_beginning,
    ),
]


def run(
    problem: Annotated[
        Path,
        typer.Argument(help="The problem file; - reads it from stdin.", metavar="PROBLEM.yaml"),
    ],
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            help="Write the result: .json, .npz with histories, .csv a table; repeatable.",
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the run into a picture.")] = None,
    view_from: ViewFrom = "front-left",
    show: Show = "all",
    solver: Annotated[
        str | None,
        typer.Option(
            help="QP solver; short for --set controller.solver=NAME.",
            autocompletion=solvers_beginning,
        ),
    ] = None,
    assign: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="PATH=VALUE",
            help="Replace a value of the file, as in --set tasks.com.gain=0.3; repeatable.",
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
    view: Annotated[
        bool,
        typer.Option("--view", help="Watch it in a browser; the page stays until Ctrl-C."),
    ] = False,
) -> None:
    """Run a problem and say what came of it."""
    with errors_in_one_line():
        check_view(view_from, show)
        overrides = overrides_of(assign, solver)
        look = (view_from, show)
        code = _solve(problem, output or [], plot, look, overrides, quiet, view)
    raise typer.Exit(code)


def check_view(view_from: str, show: str) -> None:
    """Raise for words that no picture can be drawn by, before any work is done."""
    from wbc.view.options import View

    View.of(view_from, show)


def overrides_of(assignments: list[str] | None, solver: str | None = None) -> dict[str, Any]:
    """Return what ``--set`` and ``--solver`` replace, by key path."""
    from wbc.problem import parse_override

    overrides = dict(parse_override(assignment) for assignment in assignments or [])
    return overrides if solver is None else {**overrides, "controller.solver": solver}


def _solve(
    path: Path,
    output: list[Path],
    plot: Path | None,
    look: tuple[str, str],
    overrides: dict[str, Any],
    quiet: bool,
    view: bool,
) -> int:
    """Run a problem, write and print what came of it, and return the exit code."""
    from wbc.cli.outputs import Outputs, check_picture, check_place, draw_result
    from wbc.cli.printing import print_pendulum_result, print_result
    from wbc.problem import Problem, Result, load_problem
    from wbc.run.saving import result_format
    from wbc.view.live.process import require_viser

    for each in output:
        result_format(each)
        check_place("--output", each)
    if plot is not None:
        check_picture("--plot", plot)
    if view:
        require_viser()
    problem = load_problem(path, overrides)
    if isinstance(problem, Problem) and not quiet:
        print_notes(problem.parts.robot)
    name = "stdin" if str(path) == "-" else path.stem
    watching = watched(problem, name) if view else None
    result, interrupts = _run(problem, quiet, watching)
    interrupted = interrupts() or _search_interrupted(result)
    if interrupted and not output:
        output = [Path(tempfile.mkdtemp(prefix="wbc-")) / f"{name}.npz"]
    outputs = Outputs()
    for each in output:
        outputs.save(each, result.save)
    if plot is not None:
        outputs.draw(plot, lambda picture: draw_result(result, picture, name, *look))
    if not quiet:
        if isinstance(result, Result):
            print_result(result, outputs.written)
        else:
            print_pendulum_result(result, outputs.written)
    for failure in outputs.failures:
        complain(failure)
    if interrupted:
        where = ", ".join(str(one) for one in outputs.written) or "nowhere"
        complain(f"interrupted; what was computed until then is in {where}")
        return interrupts.exit_code
    if watching is not None and isinstance(result, Result):
        watching.replay(result.history)
        typer.echo(f"the run can be played again at {watching.viewer.url}; Ctrl-C ends", err=True)
        watching.viewer.wait()
    return BAD_INPUT if outputs.failures else _exit_code(result)


def _run(
    problem: Problem | PendulumProblem, quiet: bool, watching: Watching | None
) -> tuple[Result | PendulumResult, Interrupts]:
    """Run a problem, until its end or a signal."""
    from wbc.cli.interrupts import Interrupts, noted_interrupts
    from wbc.cli.progress import shown_progress
    from wbc.problem import Problem

    with nullcontext() if quiet else shown_progress() as progress:
        if not isinstance(problem, Problem) and problem.spec.plan is not None:
            return problem.run(progress), Interrupts()  # nothing to keep until it is done
        with noted_interrupts() as interrupts:
            if watching is not None and isinstance(problem, Problem):
                return problem.run(progress, cancelled=interrupts, show=watching.show), interrupts
            return problem.run(progress, cancelled=interrupts), interrupts


def watched(problem: Problem | PendulumProblem, name: str) -> Watching:
    """Return what shows a problem's run.

    Raises
    ------
    InvalidInputError
        A pendulum's problem: the viewer shows robots.
    """
    from wbc.errors import InvalidInputError
    from wbc.problem import Problem
    from wbc.view.live.watching import Watching

    if not isinstance(problem, Problem):
        raise InvalidInputError("--view shows robots, and this is a pendulum's problem; use --plot")
    return Watching(problem.parts.robot, title=name)


def _search_interrupted(result: Result | PendulumResult) -> bool:
    """Return whether Ctrl-C ended the search over postures, which listens for it itself."""
    shaping = getattr(result, "shaping", None)
    return shaping is not None and shaping.effort.stopped == "interrupted"


def _exit_code(result: Result | PendulumResult) -> int:
    from wbc.problem import RunStatus

    if result.status.good:
        return 0
    return QP_FAILED if result.status is RunStatus.QP_FAILED else NOT_REACHED
