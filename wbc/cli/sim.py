"""``wbc sim``: a problem of the torque level in physics, printed, written and drawn."""

from __future__ import annotations

import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.completion import solvers_beginning
from wbc.cli.errors import (
    BAD_INPUT,
    NOT_REACHED,
    QP_FAILED,
    complain,
    errors_in_one_line,
    print_notes,
)
from wbc.cli.run import overrides_of, watched

if TYPE_CHECKING:
    from wbc.cli.interrupts import Interrupts
    from wbc.problem import Problem
    from wbc.simulation import SimulationResult
    from wbc.view.live.watching import Watching

SIM_EXIT_CODES = (
    "Exit codes: 0 it stood, and every tolerance was met; 1 bad input, or the physics blew up; 2"
    " wrong usage; 3 it fell, or a tolerance was not met; 4 a tick had no solution; 130 or 143"
    " ended by Ctrl-C or SIGTERM, with what was computed until then written."
)


def sim(
    problem: Annotated[
        Path,
        typer.Argument(
            help="A problem of the torque level; - reads it from stdin.", metavar="PROBLEM.yaml"
        ),
    ],
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            help="Write the result: .json, .npz with histories, .csv a table; repeatable.",
        ),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the simulation into a picture.")] = None,
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
            help="Replace a value of the file, as in --set simulation.friction=0.3; repeatable.",
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
    view: Annotated[
        bool,
        typer.Option("--view", help="Watch it in a browser; the page stays until Ctrl-C."),
    ] = False,
) -> None:
    """Simulate a problem of the torque level and say whether the robot stood."""
    with errors_in_one_line():
        code = _simulate(problem, output or [], plot, overrides_of(assign, solver), quiet, view)
    raise typer.Exit(code)


def _simulate(
    path: Path,
    output: list[Path],
    plot: Path | None,
    overrides: dict[str, Any],
    quiet: bool,
    view: bool,
) -> int:
    """Simulate a problem, write and print what came of it, and return the exit code."""
    from wbc.cli.outputs import Outputs, check_picture, check_place
    from wbc.cli.sim_report import print_simulation
    from wbc.errors import InvalidInputError
    from wbc.problem import Problem, load_problem
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
    if not isinstance(problem, Problem):
        raise InvalidInputError(f"{path}: a pendulum's problem simulates itself: wbc run {path}")
    if not quiet:
        print_notes(problem.parts.robot)
    name = "stdin" if str(path) == "-" else path.stem
    watching = watched(problem, name) if view else None
    result, interrupts = _run(problem, quiet, watching)
    if interrupts() and not output:
        output = [Path(tempfile.mkdtemp(prefix="wbc-")) / f"{name}.npz"]
    outputs = Outputs()
    for each in output:
        outputs.save(each, result.save)
    if plot is not None:
        outputs.draw(plot, lambda picture: _draw(result, picture, name))
    if not quiet:
        print_simulation(result, outputs.written)
    for failure in outputs.failures:
        complain(failure)
    if interrupts():
        where = ", ".join(str(one) for one in outputs.written) or "nowhere"
        complain(f"interrupted; what was computed until then is in {where}")
        return interrupts.exit_code
    if watching is not None:
        watching.replay(result.run.history)
        typer.echo(f"it can be played again at {watching.viewer.url}; Ctrl-C ends", err=True)
        watching.viewer.wait()
    return BAD_INPUT if outputs.failures else _exit_code(result)


def _run(
    problem: Problem, quiet: bool, watching: Watching | None
) -> tuple[SimulationResult, Interrupts]:
    """Simulate a problem, until its end, a fall or a signal."""
    from wbc.cli.interrupts import noted_interrupts
    from wbc.cli.progress import shown_progress

    with (
        nullcontext() if quiet else shown_progress() as progress,
        noted_interrupts() as interrupts,
    ):
        show = None if watching is None else watching.show
        return problem.simulate(progress, cancelled=interrupts, show=show), interrupts


def _draw(result: SimulationResult, path: Path, name: str) -> None:
    from wbc.view.simulation import plot_simulation

    plot_simulation(result.robot, result.arrays, path, title=f"{name}: {result.reason}")


def _exit_code(result: SimulationResult) -> int:
    from wbc.simulation import SimulationStatus

    if result.status.good:
        return 0
    return QP_FAILED if result.status is SimulationStatus.QP_FAILED else NOT_REACHED
