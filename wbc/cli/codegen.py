"""``wbc codegen``: the controller of a problem, or a pendulum's equations of motion, as C."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import print_note
from wbc.cli.options import Assign, overrides_of

if TYPE_CHECKING:
    from wbc.rmp.pendulum import ReactionMassPendulum


PENDULUMS = ("planar", "solid", "euler")


def codegen(
    what: Annotated[
        str,
        typer.Argument(
            help="A problem file; or a pendulum: planar, solid (orientation by quaternion) or euler"
            " (by angles).",
            metavar="PROBLEM.yaml|PENDULUM",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Folder to write into, made if it is missing; . by default for a pendulum.",
        ),
    ] = None,
    assign: Assign = None,
    ticks: Annotated[
        int | None, typer.Option(help="Ticks recorded of a problem, 200 by default.", min=1)
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option(
            help="The problem's robot on its bus, as unitree_g1: write estimator, safety layer and"
            " the loop over UDP, too."
        ),
    ] = None,
    mass: Annotated[float | None, typer.Option(help="Mass of the pendulum, in kg.")] = None,
    gravity: Annotated[
        float | None, typer.Option(help="Gravity of the pendulum, 9.81 m/s^2 by default.")
    ] = None,
    function: Annotated[
        list[str] | None,
        typer.Option(help="Of a pendulum this function only, as in mass_matrix; repeatable."),
    ] = None,
) -> None:
    """Write the controller of a problem as C: the native core, its plan, and a recorded run.

    Or a pendulum's equations of motion, with a header.
    """
    of_problem = {"--set": assign, "--ticks": ticks, "--robot": robot}
    of_pendulum = {"--mass": mass, "--gravity": gravity, "--function": function}
    if what in PENDULUMS:
        _refuse(of_problem, "a problem", what)
        _pendulum(what, mass, gravity, output or Path("."), function)
    else:
        _refuse(of_pendulum, "a pendulum", what)
        _problem(Path(what), output, assign, ticks or 200, robot)


def _refuse(options: Mapping[str, object], kind: str, what: str) -> None:
    from wbc.errors import InvalidInputError

    for name, given in options.items():
        if given is not None:
            raise InvalidInputError(f"{name}: belongs to {kind}, and {what} is none")


def _problem(
    path: Path, folder: Path | None, assign: list[str] | None, ticks: int, robot: str | None
) -> None:
    from wbc.codegen import export_problem
    from wbc.errors import InvalidInputError, UnknownNameError
    from wbc.hardware.unitree import profile_named

    if not path.suffix and not path.exists():
        raise UnknownNameError("problem file or pendulum", str(path), PENDULUMS)
    if folder is None:
        raise InvalidInputError("a problem is written into a folder of its own: give --output")
    made = export_problem(
        path, folder, overrides_of(assign), ticks, None if robot is None else profile_named(robot)
    )
    if made.solver is not None:
        print_note(f"solved by active_set, as C is, not by {made.solver}")
    for reason, count in made.recording.left_out.items():
        print_note(f"in {count} ticks, left out, C gives no command: {reason}")
    if made.recording.fell:
        print_note(f"the recorded robot {made.recording.fell}")
    for note in made.left_out:
        print_note(note)
    count = len(made.recording.ticks)
    typer.echo(f"written  {folder}: the controller, and {count} ticks of Python to compare with")
    typer.echo(f"now try  make -C {quote(str(folder))} run")
    if robot is not None:
        typer.echo(f"and      make -C {quote(str(folder / 'hardware'))} run")


def _pendulum(
    model: str, mass: float | None, gravity: float | None, output: Path, function: list[str] | None
) -> None:
    from wbc.errors import InvalidInputError
    from wbc.rmp.functions import export_c
    from wbc.rmp.planar import PlanarRmp
    from wbc.rmp.solid import EulerSolidRmp, SolidRmp
    from wbc.spatial import STANDARD_GRAVITY

    if mass is None:
        raise InvalidInputError(f"{model}: give --mass, in kg")
    kinds: dict[str, Callable[[float, float], ReactionMassPendulum]]
    kinds = {"planar": PlanarRmp, "solid": SolidRmp, "euler": EulerSolidRmp}
    pendulum = kinds[model](mass, STANDARD_GRAVITY if gravity is None else gravity)
    output.mkdir(parents=True, exist_ok=True)
    source = export_c(pendulum, output, function or None)
    typer.echo(f"{source} and {source.with_suffix('.h').name}")
    for name in function or pendulum.functions:
        typer.echo(f"  {pendulum.functions[name]}")
