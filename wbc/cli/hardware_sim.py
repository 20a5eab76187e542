"""``wbc hardware sim``: a simulated robot on a bus."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.errors import print_note
from wbc.cli.hardware_options import Bus, Domain, Interface, OnBus, Priority, Slower
from wbc.cli.options import Quiet, robots_beginning

FOREVER = 1e9  # s


def sim(
    model: Annotated[
        str, typer.Argument(help="The robot: a name, or a file.", autocompletion=robots_beginning)
    ] = "g1",
    robot: OnBus = "unitree_g1",
    bus: Bus = "unitree",
    interface: Interface = "lo",
    domain: Domain = 0,
    truth: Annotated[
        bool, typer.Option("--truth", help="Also send the base's true state.")
    ] = False,
    no_gantry: Annotated[
        bool, typer.Option("--no-gantry", help="Without straps: a fall is not caught.")
    ] = False,
    lifted: Annotated[
        float, typer.Option(help="Raise the gantry by this, in m: 0.1 for wbc hardware check.")
    ] = 0.0,
    push: Annotated[
        list[str] | None,
        typer.Option(
            metavar="AT,FX,FY,SECONDS", help="Push the trunk at a time, in s and N; repeatable."
        ),
    ] = None,
    push_body: Annotated[str, typer.Option(help="The body that is pushed.")] = "base",
    patience: Annotated[
        float, typer.Option(help="Seconds without a command after which it brakes.", min=0.001)
    ] = 0.017,
    armature: Annotated[float, typer.Option(help="Of the rotors, in kg m^2.", min=0.0)] = 0.003,
    duration: Annotated[
        float | None, typer.Option(help="Time until it ends, in s; else Ctrl-C ends it.", min=0.0)
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Write its events: a .json.")] = None,
    priority: Priority = 50,
    slower: Slower = 1.0,
    cpu: Annotated[int | None, typer.Option(help="CPU to run on.")] = None,
    quiet: Quiet = False,
) -> None:
    """Simulate a robot on a bus: physics, motors at 1 kHz, messages, a watchdog that brakes.

    It hangs in its gantry's straps at the height of its crouch, feet on the ground.
    """
    import json

    from wbc.cli.interrupts import noted_interrupts
    from wbc.cli.outputs import check_place
    from wbc.errors import WbcError
    from wbc.extras import require
    from wbc.files import write_text
    from wbc.hardware.real_time import check_cpus, pin, real_time, slow_down
    from wbc.hardware.robot_side import RobotSettings
    from wbc.hardware.setup import Where, simulated_robot
    from wbc.hardware.unitree import profile_named
    from wbc.robot import Robot

    require("mujoco", "wbc hardware sim")
    if report is not None:
        check_place("--report", report)
    check_cpus(() if cpu is None else (cpu,))
    pushes = [_push_of(one) for one in push or ()]
    loaded, profile = Robot.load(model, armature=armature), profile_named(robot)
    settings = RobotSettings(truth=truth, gantry=not no_gantry, patience=patience)
    slow_down(slower)
    with real_time(priority):  # which the bus's own threads inherit
        end = Where(bus, interface, domain).open_robot(profile, loaded)
    try:
        simulated = simulated_robot(loaded, profile, end, settings, lifted=lifted)
        for at, fx, fy, seconds in pushes:
            simulated.push(at, push_body, (fx, fy, 0.0), seconds)
    except WbcError:
        end.close()
        raise
    pin(cpu)
    with noted_interrupts(hangup=True) as interrupts:
        if not quiet:
            typer.echo(f"{loaded.name} on {bus} {interface}: ready")
        seconds = FOREVER if duration is None else duration
        outcome = simulated.run(seconds, cancelled=interrupts, priority=priority, say=print_note)
    if report is not None:
        write_text(report, json.dumps(outcome.to_data()) + "\n")
    if not quiet:
        for event in outcome.events:
            typer.echo(f"{event.time:.4f}  {event.what}")
        typer.echo(
            f"{outcome.commands} commands, {outcome.damaged} damaged; tilted by at most"
            f" {outcome.tilt:.2f} rad; {outcome.late} of {outcome.steps} steps made up for,"
            f" {1e3 * outcome.latest:.1f} ms late at most"
        )
    raise typer.Exit(interrupts.exit_code if interrupts() else 0)


def _push_of(text: str) -> tuple[float, float, float, float]:
    from wbc.errors import InvalidInputError

    try:
        at, fx, fy, seconds = (float(word) for word in text.split(","))
    except ValueError:
        raise InvalidInputError(f"--push {text}: expected AT,FX,FY,SECONDS") from None
    return at, fx, fy, seconds
