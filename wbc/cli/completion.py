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
