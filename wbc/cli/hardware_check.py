"""``wbc hardware check``: whether a robot matches its model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import complain, print_note
from wbc.cli.hardware_options import STOPPED, Bus, Domain, Interface, OnBus, Priority, Slower
from wbc.cli.options import robots_beginning

if TYPE_CHECKING:
    from wbc.hardware.setup import Where
    from wbc.robot import Robot


def check(
    model: Annotated[
        str, typer.Argument(help="The robot's model.", autocompletion=robots_beginning)
    ] = "g1",
    robot: OnBus = "unitree_g1",
    bus: Bus = "unitree",
    interface: Interface = "lo",
    domain: Domain = 0,
    move: Annotated[
        bool | None, typer.Option("--move/--no-move", help="Move joints, or not, without asking.")
    ] = None,
    priority: Priority = 40,
    slower: Slower = 1.0,
) -> None:
    """Check a robot: bus, rates, sensors; then, after asking, order and sign of each joint."""
    from wbc.hardware.check import CheckFinding, CheckGains, listen, move_joints
    from wbc.hardware.real_time import real_time, slow_down
    from wbc.hardware.setup import Where, safety_of
    from wbc.hardware.unitree import profile_named
    from wbc.hardware.unitree.profiles import by_pattern
    from wbc.robot import Robot

    loaded, profile = Robot.load(model), profile_named(robot)
    where = Where(bus, interface, domain)
    slow_down(slower)
    end = where.open(profile, loaded)
    wrong = 0

    def report(finding: CheckFinding) -> None:
        nonlocal wrong
        wrong += not finding.good
        mark = typer.style("ok   ", fg="green") if finding.good else typer.style("WRONG", fg="red")
        typer.echo(f"{mark} {finding.what:28s} {finding.seen}")

    with real_time(priority) as not_granted:
        for note in not_granted:
            print_note(note)
        for finding in listen(end, loaded, up=profile.up(loaded)):
            report(finding)
        if wrong:
            complain("joints are not moved before this is fixed")
            raise typer.Exit(STOPPED)
        if move is None:
            move = _confirm_motion(loaded, where)
        if move:
            kp, kd = by_pattern(loaded, profile.stiffness), by_pattern(loaded, profile.holding)
            safety = safety_of(loaded, profile, 0.002)
            move_joints(end, loaded, safety, CheckGains(kp, kd), report=report)
    end.close()
    raise typer.Exit(STOPPED if wrong else 0)


def _confirm_motion(robot: Robot, where: Where) -> bool:
    count = len(robot.joint_names)
    typer.echo(
        f"Now each of the {count} joints of the robot on {where.interface!r} is moved by 2 degrees."
        "\nIt must hang freely, hands off, the stop button in reach."
    )
    return typer.prompt("Type move to go on", default="", show_default=False).strip() == "move"
