"""The command line: ``wbc run``, ``analyze``, ``codegen``, ``schema``, ``robots``, ``collisions``.

Only typer is imported on top: ``wbc --help`` must not wait for the robotics libraries.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import nullcontext
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc import __version__
from wbc.cli.analyze import analyze
from wbc.cli.errors import (
    BAD_INPUT,
    NOT_REACHED,
    QP_FAILED,
    complain,
    errors_in_one_line,
    print_notes,
)

if TYPE_CHECKING:
    from wbc.problem import Result
    from wbc.problem.pendulum.result import PendulumResult
    from wbc.rmp.pendulum import ReactionMassPendulum

app = typer.Typer(
    help="Whole-body control of humanoid robots, with the robot's inertia as a task.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


class Model(StrEnum):
    """Which pendulum."""

    PLANAR = "planar"
    SOLID = "solid"
    EULER = "euler"


_SILENT = logging.NullHandler()  # what the library warns of is among the notes printed here


def main() -> None:
    """Run the command line; the entry point of the ``wbc`` script."""
    app()


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"wbc {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """Whole-body control of humanoid robots, with the robot's inertia as a task."""
    logging.getLogger("wbc").addHandler(_SILENT)


# ---------------------------------------------------------------------- wbc run


@app.command(
    epilog="Exit codes: 0 solved; 1 bad input; 2 wrong usage; 3 not at rest or a tolerance not met "
    "in time, or balance, contacts or margins not kept; 4 a QP failed."
)
def run(
    problem: Annotated[Path, typer.Argument(help="The problem file.", metavar="PROBLEM.yaml")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Write the result: .json, or .npz with histories."),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the run into a picture.")] = None,
    solver: Annotated[
        str | None, typer.Option(help="QP solver; short for --set controller.solver=NAME.")
    ] = None,
    assign: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="PATH=VALUE",
            help="Replace a value of the file, as in --set tasks.com.gain=0.3; repeatable.",
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")] = False,
) -> None:
    """Run a problem and say what came of it."""
    with errors_in_one_line():
        code = _solve(problem, output, plot, _overrides(assign or [], solver), quiet)
    raise typer.Exit(code)


def _solve(
    path: Path, output: Path | None, plot: Path | None, overrides: dict[str, Any], quiet: bool
) -> int:
    """Run a problem, write and print what came of it, and return the exit code."""
    from wbc.cli.outputs import Outputs, check_picture, check_place, draw_result
    from wbc.cli.printing import print_pendulum_result, print_result
    from wbc.cli.progress import shown_progress
    from wbc.problem import Problem, Result, load_problem
    from wbc.run.saving import result_format

    if output is not None:
        result_format(output)
        check_place("--output", output)
    if plot is not None:
        check_picture("--plot", plot)
    problem = load_problem(path, overrides)
    if isinstance(problem, Problem) and not quiet:
        print_notes(problem.parts.robot)
    with nullcontext() if quiet else shown_progress() as progress:
        result = problem.run(progress)
    outputs = Outputs()
    if output is not None:
        outputs.save(output, result.save)
    if plot is not None:
        outputs.draw(plot, lambda picture: draw_result(result, picture, path.stem))
    if not quiet:
        if isinstance(result, Result):
            print_result(result, outputs.written)
        else:
            print_pendulum_result(result, outputs.written)
    for failure in outputs.failures:
        complain(failure)
    return BAD_INPUT if outputs.failures else _exit_code(result)


def _overrides(assignments: list[str], solver: str | None) -> dict[str, Any]:
    from wbc.problem import parse_override

    overrides = dict(parse_override(assignment) for assignment in assignments)
    return overrides if solver is None else {**overrides, "controller.solver": solver}


def _exit_code(result: Result | PendulumResult) -> int:
    from wbc.problem import RunStatus

    if result.status.good:
        return 0
    return QP_FAILED if result.status is RunStatus.QP_FAILED else NOT_REACHED


# ---------------------------------------------------------------------- other commands


@app.command()
def schema(
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write to a file instead.")
    ] = None,
) -> None:
    """Print the JSON Schema of problem files, for completion and checks in an editor."""
    with errors_in_one_line():
        import json

        from wbc.cli.outputs import check_place
        from wbc.problem.json_schema import json_schema

        text = json.dumps(json_schema(), indent=2)
        if output is None:
            typer.echo(text)
            return
        check_place("--output", output)
        output.write_text(text + "\n", encoding="utf-8")


@app.command()
def robots(
    name: Annotated[
        str | None, typer.Argument(help="Describe this robot: a name, or a URDF or MJCF file.")
    ] = None,
) -> None:
    """List the robots that a problem can name, or describe one."""
    with errors_in_one_line():
        from wbc.errors import ModelError
        from wbc.robot import Robot
        from wbc.robot.library import find_robot, robot_names

        if name is not None:
            robot = Robot.load(name)
            base = "fixed" if robot.fixed_base else "floating"
            typer.echo(f"{robot.name}  {robot.path}")
            typer.echo(f"{len(robot.joint_names)} joints, {robot.mass:.2f} kg, {base} base")
            feet = ", ".join(f"{foot.name} ({foot.link})" for foot in robot.feet.values())
            typer.echo(f"feet: {feet or 'none'}")
            typer.echo(f"postures: {', '.join(robot.postures)}")
            print_notes(robot)
            return
        width = max(len(name) for name in robot_names())
        for name in robot_names():
            try:
                where = str(find_robot(name).path)
            except ModelError:
                where = "not installed (pip install 'wbc[robots]')"
            typer.echo(f"{name:{width}}  {where}")


@app.command()
def codegen(
    model: Annotated[
        Model,
        typer.Argument(help="planar, solid (orientation by quaternion) or euler (by angles)."),
    ],
    mass: Annotated[float, typer.Option(help="Mass of the pendulum, in kg.")],
    gravity: Annotated[float, typer.Option(help="Gravity, in m/s^2.")] = 9.81,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Folder to write into; it must exist.")
    ] = Path("."),
    function: Annotated[
        list[str] | None,
        typer.Option(help="Write this function only, as in mass_matrix; repeatable."),
    ] = None,
    compiler: Annotated[
        str | None,
        typer.Option(help="C compiler, such as cc: compile too, and compare with CasADi."),
    ] = None,
) -> None:
    """Write a pendulum's equations of motion as C, with a header; compile and compare them."""
    with errors_in_one_line():
        from wbc.rmp.functions import compile_c, export_c, largest_difference
        from wbc.rmp.planar import PlanarRmp
        from wbc.rmp.solid import EulerSolidRmp, SolidRmp

        kinds: dict[Model, Callable[[float, float], ReactionMassPendulum]]
        kinds = {Model.PLANAR: PlanarRmp, Model.SOLID: SolidRmp, Model.EULER: EulerSolidRmp}
        pendulum = kinds[model](mass, gravity)
        source = export_c(pendulum, output, function or None)
        typer.echo(f"{source} and {source.with_suffix('.h').name}")
        names = function or list(pendulum.functions)
        for name in names:
            typer.echo(f"  {pendulum.functions[name]}")
        if compiler is not None:
            library = compile_c(source, compiler)
            difference = largest_difference(pendulum, library, names)
            typer.echo(f"{library}: differs from CasADi by {difference:.1e} at most (relative)")


@app.command()
def collisions(
    robot: Annotated[str, typer.Argument(help="Name or file of a robot.")],
    margin: Annotated[float, typer.Option(help="Distance that bodies keep [m].")] = 0.01,
    fit: Annotated[str, typer.Option(help="capsule or hull")] = "capsule",
) -> None:
    """List the pairs of a robot's bodies that self-collision does not watch, and why."""
    with errors_in_one_line():
        from wbc.constraints import SelfCollision
        from wbc.robot import Robot

        loaded = Robot.load(robot)
        print_notes(loaded)
        margins = SelfCollision(loaded, margin=margin, fit=fit)
        typer.echo(f"{len(margins.model.pairs)} pairs are watched; with finer shapes:")
        for pair, why in margins.finer.items():
            typer.echo(f"  {pair}: {why}")
        typer.echo(f"{len(margins.excluded)} pairs are not watched:")
        for pair, why in sorted(margins.excluded.items(), key=lambda both: both[1]):
            typer.echo(f"  {pair}: {why}")


app.command()(analyze)
