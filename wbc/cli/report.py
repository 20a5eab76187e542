"""``wbc report``: a run as one HTML file that opens offline."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import errors_in_one_line
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
        from wbc.cli.outputs import check_place, require_matplotlib, write_one
        from wbc.cli.saved import saved_or_run, title_of

        require_matplotlib("wbc report")
        from wbc.view.report.report import report_format

        report_format(output)
        check_place("--output", output)
        saved = saved_or_run(run, robot, quiet)
        title = title_of(saved)
        code = write_one(output, lambda path: _write(saved, path, title), quiet)
    raise typer.Exit(code)


def _write(saved: SavedRun | SavedPendulum, path: Path, title: str) -> None:
    from wbc.problem.pendulum.saved import SavedPendulum
    from wbc.view.report.report import write_pendulum_report, write_report

    if isinstance(saved, SavedPendulum):
        write_pendulum_report(saved.history, saved.summary, path, title=title)
        return
    run = saved.robot, saved.history, saved.summary
    write_report(*run, path, title=title, simulation=saved.simulation)
