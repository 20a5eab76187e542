"""``wbc sim``: a problem of the torque level in physics, printed, written and drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.errors import errors_in_one_line, print_notes
from wbc.cli.options import Assign, Output, Quiet, Solver, Watched, overrides_of
from wbc.cli.running import Ended, Wanted, exit_code, finish

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
    output: Output = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the simulation into a picture.")] = None,
    solver: Solver = None,
    assign: Assign = None,
    quiet: Quiet = False,
    view: Watched = False,
) -> None:
    """Simulate a problem of the torque level and say whether the robot stood."""
    with errors_in_one_line():
        wanted = Wanted(problem, output or [], plot, quiet, view)
        wanted.check()
        code = _simulate(wanted, overrides_of(assign, solver))
    raise typer.Exit(code)


def _simulate(wanted: Wanted, overrides: dict[str, Any]) -> int:
    """Simulate a problem, write and print what came of it, and return the exit code."""
    from wbc.cli.sim_report import print_simulation
    from wbc.errors import InvalidInputError
    from wbc.problem import Problem, load_problem

    path = wanted.path
    problem = load_problem(path, overrides)
    if not isinstance(problem, Problem):
        raise InvalidInputError(f"{path}: a pendulum's problem simulates itself: wbc run {path}")
    if not wanted.quiet:
        print_notes(problem.parts.robot)
    watching = wanted.watching(problem)
    result, interrupts = _run(problem, wanted.quiet, watching)
    ended = Ended(
        save=result.save,
        draw=lambda picture: _draw(result, picture, wanted.name),
        tell=lambda written: print_simulation(result, written),
        code=exit_code(result.status),
        interrupted=interrupts.exit_code if interrupts() else None,
        history=result.run.history,
    )
    return finish(wanted, ended, watching)


def _run(
    problem: Problem, quiet: bool, watching: Watching | None
) -> tuple[SimulationResult, Interrupts]:
    """Simulate a problem, until its end, a fall or a signal."""
    from wbc.cli.interrupts import noted_interrupts
    from wbc.cli.progress import shown_progress

    with shown_progress(quiet) as progress, noted_interrupts() as interrupts:
        show = None if watching is None else watching.show
        return problem.simulate(progress, cancelled=interrupts, show=show), interrupts


def _draw(result: SimulationResult, path: Path, name: str) -> None:
    from wbc.view.simulation import plot_simulation

    plot_simulation(result.robot, result.arrays, path, title=f"{name}: {result.reason}")
