"""The command line: every command of ``wbc`` is registered here.

Only typer is imported on top: ``wbc --help`` must not wait for the robotics libraries.
"""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from wbc import __version__
from wbc.cli import hardware_check, hardware_run, hardware_sim
from wbc.cli.analyze import analyze
from wbc.cli.batch import BATCH_EXIT_CODES, batch
from wbc.cli.codegen import codegen
from wbc.cli.doctor import add_bench, cache, doctor
from wbc.cli.errors import BAD_INPUT, Commands, complain, print_warnings, refused
from wbc.cli.hardware_options import HARDWARE_EXIT_CODES
from wbc.cli.problems import check, init, schema
from wbc.cli.push import PUSH_EXIT_CODES, push
from wbc.cli.replay import REPLAY_EXIT_CODES, replay
from wbc.cli.retarget import retarget
from wbc.cli.robots import collisions, robots
from wbc.cli.run import EXIT_CODES, SIM_EXIT_CODES, run, sim
from wbc.cli.saved import export, render, report
from wbc.cli.view import view

app = typer.Typer(
    cls=Commands,
    help="Whole-body control of humanoid robots, with the robot's inertia as a task.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Run the command line; the entry point of the ``wbc`` script."""
    code: object = 0
    for name in ("stdout", "stderr"):  # closed, as some that start programs leave them
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_WRONLY)  # the lowest number that is free: its own
            os.set_inheritable(null, True)  # packages start programs that write there, too
            setattr(sys, name, open(null, "w"))  # noqa: SIM115 (until the end)
    try:
        app()
    except SystemExit as end:
        code = end.code
    except OSError as error:  # of typer's own, as the help on a full disk
        complain(refused(error))
        code = BAD_INPUT
    try:
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes again
        if not code:
            complain(refused(error))
            code = BAD_INPUT
    raise SystemExit(code)


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
    print_warnings()


# One line for each command, in the order of the help.
app.command(epilog=EXIT_CODES)(run)
app.command(epilog=SIM_EXIT_CODES)(sim)
app.command(epilog=PUSH_EXIT_CODES)(push)
app.command(epilog=BATCH_EXIT_CODES)(batch)
add_bench(app)
app.command()(view)
app.command()(render)
app.command()(report)
app.command()(export)
app.command(epilog=REPLAY_EXIT_CODES)(replay)
app.command()(init)
app.command()(check)
app.command()(analyze)
app.command()(retarget)
app.command()(robots)
app.command()(collisions)
app.command()(schema)
app.command()(codegen)
hardware = typer.Typer(
    cls=Commands,
    help="On a robot: run a problem, be a simulated robot, check a real one.",
    no_args_is_help=True,
)
for command in (hardware_run.run, hardware_sim.sim, hardware_check.check):
    hardware.command(epilog=HARDWARE_EXIT_CODES)(command)
app.add_typer(hardware, name="hardware")
app.command()(doctor)
app.command()(cache)
