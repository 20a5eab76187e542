"""``wbc view``: a problem in the browser, while it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.errors import print_notes
from wbc.cli.options import Assign, name_of, overrides_of


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
    """Run a problem in a web browser: pause it, drag targets, change weights.

    A problem of the torque level is simulated, and the robot can be pushed.
    """
    from wbc.cli.progress import starting
    from wbc.extras import require

    require("viser", "wbc view")
    with starting(f"loading {problem}"):
        from wbc.problem import load_problem
        from wbc.view.live.clock import Clock
        from wbc.view.live.session import Session, checked
        from wbc.view.live.simulated import SimulatedSession, strongest_push
        from wbc.view.live.viewer import Viewer

        clock = Clock(speed)
        loaded = checked(load_problem(problem, overrides_of(assign)))
    print_notes(loaded.parts.robot)
    simulated = loaded.spec.controller.level == "torque"
    robot, push = loaded.parts.robot, strongest_push(loaded) if simulated else 0.0
    session = SimulatedSession if simulated else Session
    with starting(f"starting the page, and reading what {robot.name} looks like"):
        viewer = Viewer(
            robot,
            host=host,
            port=port,
            title=name_of(problem),
            clock=True,
            push=push,
            terrain=loaded.spec.simulation.ground(),
        )
    with viewer as page:
        typer.echo("Ctrl-C ends it", err=True)
        try:
            session(loaded, page, clock).run()
        except KeyboardInterrupt:
            return
    if page.error:
        typer.echo(page.error, err=True)
