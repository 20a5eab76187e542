"""What the shell offers when Tab is pressed; nothing is loaded before."""

from __future__ import annotations


def robots_beginning(incomplete: str) -> list[str]:
    """Return the names of robots that begin so."""
    from wbc.robot.library import robot_names

    return [name for name in robot_names() if name.startswith(incomplete)]


def solvers_beginning(incomplete: str) -> list[str]:
    """Return the names of QP solvers that begin so."""
    from wbc.qp import installed_solvers

    return [name for name in installed_solvers() if name.startswith(incomplete)]


def directions_beginning(incomplete: str) -> list[str]:
    """Return the directions to view from that begin so."""
    from wbc.view.options import DIRECTIONS

    return [name for name in DIRECTIONS if name.startswith(incomplete)]


def layers_beginning(incomplete: str) -> list[str]:
    """Return lists of layers of a picture whose last begins so."""
    from wbc.view.options import LAYERS, WITHOUT

    before, comma, last = incomplete.rpartition(",")
    names = [*LAYERS, *(f"{WITHOUT}{name}" for name in LAYERS)]
    return [f"{before}{comma}{name}" for name in names if name.startswith(last)]
