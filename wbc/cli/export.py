"""``wbc export``: a run as a file that other programs' viewers open."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.errors import errors_in_one_line
from wbc.cli.options import Quiet, RobotOfResult, SavedOrProblem


def export(
    run: SavedOrProblem,
    output: Annotated[Path, typer.Option("--output", "-o", help="The file: .mcap.")],
    robot: RobotOfResult = None,
    quiet: Quiet = False,
) -> None:
    """Write a run as MCAP, for Foxglove, Rerun or PlotJuggler: links, joints, errors, forces."""
    with errors_in_one_line():
        from wbc.cli.outputs import check_place, write_one
        from wbc.cli.saved import saved_or_run
        from wbc.errors import InvalidInputError
        from wbc.problem.saved import SavedRun
        from wbc.view.mcap_export import mcap_format, write_mcap

        mcap_format(output)
        check_place("--output", output)
        saved = saved_or_run(run, robot, quiet)
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
