"""The console of all outputs."""

from __future__ import annotations

from rich.console import Console


def plain_console(stderr: bool = False) -> Console:
    """Return a console that prints names as they are: ``[/j]`` may be a robot's joint."""
    return Console(stderr=stderr, highlight=False, markup=False)
