"""``wbc report``: a run as one HTML file that opens offline."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import BAD_INPUT, complain, errors_in_one_line
from wbc.cli.options import Quiet, RobotOfResult, SavedOrProblem

if TYPE_CHECKING:
    from wbc.problem.pendulum.saved import SavedPendulum
    from wbc.problem.saved import SavedRun


def report(
    run: SavedOrProblem,
    output: Annotated[Path, typer.Option("--output", "-o", help="The report: .html.")],
    robot: RobotOfResult = None,
    quiet: Quiet = False,
) -> None:
    """Write a run as one HTML file: replay in 3-D, plots, tables, the problem and versions."""
    with errors_in_one_line():
        from wbc.cli.outputs import Outputs, check_place, require_matplotlib
        from wbc.cli.saved import saved_or_run, title_of

        require_matplotlib("wbc report")
        from wbc.view.report.report import report_format

        report_format(output)
        check_place("--output", output)
        saved = saved_or_run(run, robot, quiet)
        title = title_of(saved)
        outputs = Outputs()
        outputs.save(output, lambda path: _write(saved, path, title))
        if not quiet:
            for path in outputs.written:
                typer.echo(f"written  {path} ({path.stat().st_size / 1e6:.1f} MB)")
    for failure in outputs.failures:
        complain(failure)
    raise typer.Exit(BAD_INPUT if outputs.failures else 0)


def _write(saved: SavedRun | SavedPendulum, path: Path, title: str) -> None:
    from wbc.problem.pendulum.saved import SavedPendulum
    from wbc.view.report.report import write_pendulum_report, write_report

    if isinstance(saved, SavedPendulum):
        write_pendulum_report(saved.history, saved.summary, path, title=title)
        return
    run = saved.robot, saved.history, saved.summary
    write_report(*run, path, title=title, simulation=saved.simulation)
