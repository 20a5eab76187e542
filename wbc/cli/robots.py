"""``wbc robots`` and ``wbc collisions``: the robots, and the description of one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import missing_limits, print_notes
from wbc.cli.options import robots_beginning

if TYPE_CHECKING:
    from rich.table import Table

    from wbc.robot import Robot


def robots(
    name: Annotated[
        str | None,
        typer.Argument(
            help="Describe this robot: a name, or a URDF or MJCF file.",
            autocompletion=robots_beginning,
        ),
    ] = None,
) -> None:
    """List the robots that a problem can name, or describe one: joints, limits, links, frames."""
    from wbc.errors import ModelError
    from wbc.robot import Robot
    from wbc.robot.library import find_robot, robot_names
    from wbc.robot.packages import menagerie_names

    if name is not None:
        robot = Robot.load(name)
        _describe(robot)
        print_notes(robot)
        return
    width = max(len(name) for name in robot_names())
    for name in robot_names():
        try:
            where = str(find_robot(name).path)
        except ModelError:
            where = "not installed (pip install 'wbc[robots]')"
        typer.echo(f"{name:{width}}  {where}")
    others = menagerie_names()
    for name in others:
        typer.echo(name)
    if not others:
        typer.echo("menagerie:NAME  not installed (pip install 'wbc[menagerie]')")


def _describe(robot: Robot) -> None:
    """Print everything that a problem file can name or must respect."""
    from rich.columns import Columns
    from rich.text import Text

    from wbc.cli.console import plain_console

    base = "fixed" if robot.fixed_base else "floating"
    typer.echo(f"{robot.name}  {robot.path}")
    typer.echo(f"{len(robot.joint_names)} joints, {robot.mass:.2f} kg, {base} base")
    feet = ", ".join(f"{foot.name} ({foot.link})" for foot in robot.feet.values())
    typer.echo(f"feet: {feet or 'none'}")
    typer.echo(f"postures: {', '.join(robot.postures)}")
    console = plain_console()
    console.print(_joints(robot))
    missing = missing_limits(robot)
    for name, drive in robot.couplings.items():
        follows = f"{drive.ratio:g} {drive.driver} {drive.offset:+g}"
        powers = zip(("^2", "^3", "^4"), drive.curved, strict=True)
        follows += "".join(f" {by:+g} {drive.driver}{power}" for power, by in powers if by)
        console.print(f"{name} follows: {follows}")
    for name, loop in robot.loops.items():
        console.print(f"loop {name} ({loop.kind}): {' = '.join(loop.frames)}")
    if robot.unactuated:
        console.print(f"without a motor: {', '.join(robot.unactuated)}")
    console.print(f"\nmissing limits: {missing or 'none'}")
    console.print("\nframes:")
    console.print(Columns(map(Text, robot.frame_names), padding=(0, 2), column_first=True))


def _joints(robot: Robot) -> Table:
    """Return a table of the joints with their limits, and the mass that each carries."""
    from rich.text import Text

    from wbc.cli.printing import heads

    limits, model = robot.limits, robot.model
    columns = ("lower", "upper", "speed [/s]", "effort", "mass [kg]")
    table = heads("joint [rad, N m; m, N]", *columns)
    table.add_row(Text("base"), "", "", "", "", f"{model.inertias[1].mass:#.4g}")
    for k, name in enumerate(limits.names):
        bounds = (limits.lower[k], limits.upper[k], limits.velocity[k], limits.effort[k])
        told = ("none" if math.isinf(one) else f"{one:.4g}" for one in bounds)
        mass = model.inertias[model.getJointId(name)].mass
        table.add_row(Text(name), *told, f"{mass:#.4g}")
    return table


def collisions(
    robot: Annotated[
        str, typer.Argument(help="Name or file of a robot.", autocompletion=robots_beginning)
    ],
    margin: Annotated[float, typer.Option(help="Distance that bodies keep, in m.")] = 0.01,
    fit: Annotated[str, typer.Option(help="capsule or hull")] = "capsule",
) -> None:
    """List the pairs of a robot's bodies that self-collision does not watch, and why."""
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
