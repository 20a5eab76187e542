"""What the commands of ``wbc hardware`` are told alike: which robot, over which bus."""

from __future__ import annotations

from typing import Annotated

import typer

HARDWARE_EXIT_CODES = (
    "Exit codes: 0 it went as asked; 1 bad input, or no robot; 2 wrong usage; 3 a fault stopped it,"
    " or a check was not passed; 130, 143 or 129 ended by Ctrl-C, SIGTERM or a terminal that is"
    " gone."
)
STOPPED = 3


def robots_on_buses(incomplete: str) -> list[str]:
    """Return the names of robots on buses that begin so."""
    from wbc.hardware.unitree import PROFILES

    return [name for name in PROFILES if name.startswith(incomplete)]


OnBus = Annotated[
    str,
    typer.Option(
        "--robot",
        help="Which robot is on the bus, as unitree_g1: joint order, gains, messages.",
        autocompletion=robots_on_buses,
    ),
]
Bus = Annotated[str, typer.Option(help="unitree (DDS, extra unitree), or udp (needs nothing).")]
Interface = Annotated[
    str, typer.Option(help="Network interface, as eth0, or lo; with --bus udp an address.")
]
Domain = Annotated[int, typer.Option(help="DDS domain; with --bus udp, moves the ports.", min=0)]
Priority = Annotated[
    int, typer.Option(help="Of SCHED_FIFO, where allowed; 0 asks for none.", min=0, max=99)
]
Slower = Annotated[
    float,
    typer.Option(
        help="Slow motion, so many times, on lo, of run and sim alike: for slow machines.", min=1.0
    ),
]
Cpus = Annotated[
    list[int] | None,
    typer.Option(help="CPU to run on; a second one for the controller. Keep others off it."),
]
