"""``wbc hardware``: run a problem on a robot, be a robot, check one."""

from __future__ import annotations

import typer

from wbc.cli.hardware_check import check
from wbc.cli.hardware_options import HARDWARE_EXIT_CODES
from wbc.cli.hardware_run import run
from wbc.cli.hardware_sim import sim
from wbc.cli.mistakes import Commands

hardware = typer.Typer(
    cls=Commands,
    help="On a robot: run a problem, be a simulated robot, check a real one.",
    no_args_is_help=True,
)
for command in (run, sim, check):
    hardware.command(epilog=HARDWARE_EXIT_CODES)(command)
