"""Options that the commands of ``wbc hardware`` share: which robot, over which bus."""

from __future__ import annotations

from typing import Annotated

import typer

HARDWARE_EXIT_CODES = (
    "Exit codes: 0 success; 1 bad input, or no robot; 2 wrong usage; 3 a fault stopped the robot,"
    " or a check failed; 130, 143 or 129 ended by Ctrl-C, SIGTERM or a closed terminal."
)
STOPPED = 3


def robots_on_buses(incomplete: str) -> list[str]:
    """Return the names of robots on buses with this beginning."""
    from wbc.hardware.unitree import PROFILES

    return [name for name in PROFILES if name.startswith(incomplete)]


OnBus = Annotated[
    str,
    typer.Option(
        "--robot",
        help="The robot on the bus, such as unitree_g1: joint order, gains, messages.",
        autocompletion=robots_on_buses,
    ),
]
Bus = Annotated[
    str, typer.Option(help="unitree (DDS, extra unitree), or udp (no further package).")
]
Interface = Annotated[
    str, typer.Option(help="Network interface, such as eth0, or lo; with --bus udp an address.")
]
Domain = Annotated[int, typer.Option(help="DDS domain; with --bus udp offsets the ports.", min=0)]
Priority = Annotated[
    int, typer.Option(help="Of SCHED_FIFO, where allowed; 0: none.", min=0, max=99)
]
Slower = Annotated[
    float,
    typer.Option(
        help="Factor of slow motion, on lo, the same for run and sim: for slow machines.", min=1.0
    ),
]
Cpus = Annotated[
    list[int] | None,
    typer.Option(help="CPU to run on; a second one for the controller. Reserve it for this."),
]
