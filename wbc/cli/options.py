"""Options shared by several commands, with shell completion and their conversion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from wbc.cli.errors import warn_unless_quiet

# ---------------------------------------------------------------------- what Tab offers
# Nothing is loaded before it is pressed.


def robots_beginning(incomplete: str) -> list[str]:
    """Return the names of robots that begin so."""
    from wbc.robot.library import robot_names

    return [name for name in robot_names() if name.startswith(incomplete)]


def solvers_beginning(incomplete: str) -> list[str]:
    """Return the names of QP solvers that begin so."""
    from wbc.qp import installed_solvers

    return [name for name in installed_solvers() if name.startswith(incomplete)]


def directions_beginning(incomplete: str) -> list[str]:
    """Return the directions to view from that begin so."""
    from wbc.view.options import DIRECTIONS

    return [name for name in DIRECTIONS if name.startswith(incomplete)]


def layers_beginning(incomplete: str) -> list[str]:
    """Return lists of layers of a picture whose last begins so."""
    from wbc.view.options import LAYERS, WITHOUT

    before, comma, last = incomplete.rpartition(",")
    names = [*LAYERS, *(f"{WITHOUT}{name}" for name in LAYERS)]
    return [f"{before}{comma}{name}" for name in names if name.startswith(last)]


# ---------------------------------------------------------------------- options


Output = Annotated[
    list[Path] | None,
    typer.Option(
        "--output",
        "-o",
        help="Write the result: .json, .npz with histories, .csv or .parquet a table; repeatable.",
    ),
]
Plot = Annotated[Path | None, typer.Option(help="Draw it into a picture.")]
Solver = Annotated[
    str | None,
    typer.Option(
        help="QP solver; short for --set controller.solver=NAME.", autocompletion=solvers_beginning
    ),
]
Assign = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Replace a value of the file, as in --set tasks.com.gain=0.3; repeatable.",
    ),
]
Processes = Annotated[
    int | None, typer.Option(help="Processes; by default as many as processors.", min=1)
]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print errors only.", callback=warn_unless_quiet)
]
Watched = Annotated[
    bool, typer.Option("--view", help="Watch it in a browser; the page stays until Ctrl-C.")
]
Streamed = Annotated[
    str | None,
    typer.Option(
        "--stream", help="Send ticks live: foxglove[:PORT], or rerun[:HOST:PORT or FILE.rrd]."
    ),
]
SaveTick = Annotated[
    Path | None,
    typer.Option(
        help="Save the first tick that fails, or in which something gives way: for wbc replay."
    ),
]
SavedOrProblem = Annotated[
    Path,
    typer.Argument(
        help="The result of wbc run or wbc sim, or a problem, which is run first.",
        metavar="RESULT.npz|PROBLEM.yaml",
    ),
]
RobotOfResult = Annotated[
    str | None,
    typer.Option(
        help="The robot, if its file is not where it was.", autocompletion=robots_beginning
    ),
]
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


def name_of(path: Path) -> str:
    """Return a problem's name for titles and files."""
    from wbc.files import as_text

    return "stdin" if str(path) == "-" else as_text(path.stem)


def overrides_of(assignments: list[str] | None, solver: str | None = None) -> dict[str, Any]:
    """Return the overrides of ``--set`` and ``--solver``, by key path."""
    from wbc.problem import parse_override

    overrides = dict(parse_override(assignment) for assignment in assignments or [])
    return overrides if solver is None else {**overrides, "controller.solver": solver}
