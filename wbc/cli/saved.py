"""``wbc render``, ``wbc report`` and ``wbc export``: a run as a film, a page, or a recording.

The run is read from a result's file, or made by running a problem now.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import complain, print_notes
from wbc.cli.options import Quiet, RobotOfResult, SavedOrProblem, Show, ViewFrom, name_of

if TYPE_CHECKING:
    from wbc.cli.interrupts import Interrupts
    from wbc.cli.progress import ProgressCall
    from wbc.problem import Result
    from wbc.problem.pendulum.result import PendulumResult, SavedPendulum
    from wbc.problem.saved import SavedRun
    from wbc.simulation import SimulationResult

FPS, SIZE = 20, "480x560"


def render(
    run: SavedOrProblem,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The film: .gif, or .mp4 if there is ffmpeg.")
    ],
    fps: Annotated[int, typer.Option(help="Pictures per second, at most 50.")] = FPS,
    speed: Annotated[
        float, typer.Option(help="How much faster than the run; 0.25 is slow motion.")
    ] = 1.0,
    size: Annotated[str, typer.Option(help="Width x height in pixels.")] = SIZE,
    view_from: ViewFrom = "front-left",
    show: Show = "all",
    robot: RobotOfResult = None,
    quiet: Quiet = False,
) -> None:
    """Draw a run as a film, without a screen; the same run gives the same file."""
    from wbc.cli.interrupts import noted_interrupts
    from wbc.cli.outputs import check_place
    from wbc.cli.progress import shown_progress
    from wbc.extras import require
    from wbc.problem.pendulum.result import SavedPendulum

    require("matplotlib", "wbc render")
    from wbc.view.film import film_format, film_run
    from wbc.view.options import View
    from wbc.view.pendulum_film import film_pendulum
    from wbc.view.style import literal

    view = View.of(view_from, show)
    film_format(output)
    check_place("--output", output)
    pixels = _size(size)
    saved = _saved_or_run(run, robot, quiet)
    with shown_progress(quiet) as progress, noted_interrupts() as interrupts:
        told = _progress_or_stop(progress, interrupts)
        title = literal(_title_of(saved))
        if isinstance(saved, SavedPendulum):
            film_pendulum(saved.history, output, title=title, fps=fps, speed=speed,
                          size=pixels, progress=told)  # fmt: skip
        else:
            film_run(saved.robot, saved.history, output, title=title, fps=fps, speed=speed,
                     size=pixels, view=view, terrain=saved.terrain,
                     progress=told)  # fmt: skip
    if not quiet:
        typer.echo(f"written  {output}")


def _progress_or_stop(
    progress: ProgressCall | None, interrupts: Interrupts
) -> Callable[[int, int], None]:
    """Return a function called after each picture; after a signal the film is removed."""

    def told(done: int, total: int) -> None:
        if progress is not None:
            progress(done, total, {"drawing": True})
        if interrupts():
            complain("interrupted")
            raise typer.Exit(interrupts.exit_code)

    return told


def _size(text: str) -> tuple[int, int]:
    from wbc.errors import InvalidInputError

    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and max(int(width), int(height)) <= 4096):
        raise InvalidInputError(
            f"--size {text}: expected width x height in pixels, as in {SIZE}, at most 4096 each"
        )
    return int(width), int(height)


def report(
    run: SavedOrProblem,
    output: Annotated[Path, typer.Option("--output", "-o", help="The report: .html.")],
    robot: RobotOfResult = None,
    quiet: Quiet = False,
) -> None:
    """Write a run as one HTML file: replay in 3-D, plots, tables, the problem and versions."""
    from wbc.cli.outputs import check_place, write_one
    from wbc.extras import require

    require("matplotlib", "wbc report")
    from wbc.view.report.report import report_format

    report_format(output)
    check_place("--output", output)
    saved = _saved_or_run(run, robot, quiet)
    title = _title_of(saved)
    raise typer.Exit(write_one(output, lambda path: _write_report(saved, path, title), quiet))


def _write_report(saved: SavedRun | SavedPendulum, path: Path, title: str) -> None:
    from wbc.problem.pendulum.result import SavedPendulum
    from wbc.view.report.report import write_pendulum_report, write_report

    if isinstance(saved, SavedPendulum):
        write_pendulum_report(saved.history, saved.summary, path, title=title)
        return
    run = saved.robot, saved.history, saved.summary
    write_report(*run, path, title=title, simulation=saved.simulation, terrain=saved.terrain)


def export(
    run: SavedOrProblem,
    output: Annotated[Path, typer.Option("--output", "-o", help="The file: .mcap.")],
    robot: RobotOfResult = None,
    quiet: Quiet = False,
) -> None:
    """Write a run as MCAP, for Foxglove, Rerun or PlotJuggler: links, joints, errors, forces."""
    from wbc.cli.outputs import check_place, write_one
    from wbc.errors import InvalidInputError
    from wbc.problem.saved import SavedRun
    from wbc.view.mcap_export import mcap_format, write_mcap

    mcap_format(output)
    check_place("--output", output)
    saved = _saved_or_run(run, robot, quiet)
    if not isinstance(saved, SavedRun):
        raise InvalidInputError(
            f"{run}: a pendulum, which has no links to show; its motion is written as a table"
            " by: wbc run PROBLEM.yaml -o motion.csv"
        )
    parts = saved.robot, saved.history, saved.summary
    code = write_one(
        output, lambda path: write_mcap(*parts, path, simulation=saved.simulation), quiet
    )
    raise typer.Exit(code)


# ---------------------------------------------------------------------- the run


def _saved_or_run(path: Path, robot: str | None, quiet: bool) -> SavedRun | SavedPendulum:
    """Return the run of an ``.npz``, or that of a problem file, which is run or simulated first."""
    from wbc.cli.progress import shown_progress, starting
    from wbc.errors import InvalidInputError
    from wbc.hardware.log_file import HardwareLog, is_log
    from wbc.problem import Problem, load_problem
    from wbc.problem.pendulum.result import SavedPendulum
    from wbc.problem.saved import SavedRun, load_result
    from wbc.robot import Robot

    if path.suffix.lower() == ".npz":
        if robot is None and is_log(path):
            return HardwareLog.load(path).as_run()
        saved = load_result(path, None if robot is None else Robot.load(robot))
        if isinstance(saved, SavedRun) and not quiet:
            print_notes(saved.robot)  # such as shapes that are left out of what is drawn
        return saved
    if robot is not None:
        raise InvalidInputError("--robot: only for a result's .npz; a problem names its robot")
    with starting(f"loading {path}", quiet):
        problem, name = load_problem(path), name_of(path)
    if isinstance(problem, Problem) and not quiet:
        print_notes(problem.parts.robot)
    with shown_progress(quiet) as progress:
        if not isinstance(problem, Problem):
            moved = problem.run(progress)
            _warn(moved)
            return SavedPendulum.of(moved, name)
        simulated = problem.spec.controller.level == "torque"
        result = problem.simulate(progress) if simulated else problem.run(progress)
    _warn(result)
    return SavedRun.of(result, name)


def _warn(result: Result | SimulationResult | PendulumResult) -> None:
    if not result.status.good:
        complain(f"{result.status.value.replace('_', ' ')}: {result.reason}")


def _title_of(saved: SavedRun | SavedPendulum) -> str:
    from wbc.files import as_text

    return f"{as_text(saved.name)}: {str(saved.summary['status']).replace('_', ' ')}"
