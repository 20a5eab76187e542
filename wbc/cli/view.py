"""``wbc view``: a problem in the browser, while it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.errors import errors_in_one_line, print_notes
from wbc.cli.options import Assign, overrides_of


def view(
    problem: Annotated[Path, typer.Argument(help="The problem file.", metavar="PROBLEM.yaml")],
    host: Annotated[
        str, typer.Option(help="Where to serve the page; whoever can open it may steer.")
    ] = "127.0.0.1",
    port: Annotated[
        int | None, typer.Option(help="By default the first free port from 8080 on.")
    ] = None,
    speed: Annotated[float, typer.Option(help="Times real time; 0: as fast as can be.")] = 1.0,
    assign: Assign = None,
) -> None:
    """Run a problem and look at it in a web browser: pause it, drag targets, change weights."""
    with errors_in_one_line():
        from wbc.problem import load_problem
        from wbc.view.live.clock import Clock
        from wbc.view.live.process import require_viser
        from wbc.view.live.session import Session, checked
        from wbc.view.live.viewer import Viewer

        require_viser()
        clock = Clock(speed)
        loaded = checked(load_problem(problem, overrides_of(assign)))
        print_notes(loaded.parts.robot)
        with Viewer(
            loaded.parts.robot, host=host, port=port, title=problem.stem, clock=True
        ) as page:
            typer.echo("Ctrl-C ends it", err=True)
            try:
                Session(loaded, page, clock).run()
            except KeyboardInterrupt:
                return
        if page.error:
            typer.echo(page.error, err=True)
