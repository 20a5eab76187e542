"""``wbc doctor``: installed packages, and a check of the compiled core."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

import typer

from wbc import __version__

PACKAGES = ("cffi", "pin", "coal", "proxsuite", "casadi", "numpy", "scipy", "mujoco")


def doctor() -> None:
    """Say what is installed, and how far the compiled core and Pinocchio are apart."""
    found = {name: _version(name) for name in PACKAGES}
    typer.echo(
        f"wbc {__version__}, Python {platform.python_version()}, "
        f"{platform.system()} {platform.machine()}"
    )
    typer.echo(", ".join(f"{name} {number}" for name, number in found.items()))
    for line in core_lines():
        typer.echo(line)


def core_lines() -> list[str]:
    """Return the compiled core's path, and its difference from Pinocchio on a robot.

    Raises
    ------
    ModelError
        Too far.
    """
    from wbc.native import _core
    from wbc.robot import Robot
    from wbc.robot.kernel_check import disagreement

    robot = Robot.load("hoap2_like")
    worst = disagreement(robot.native.tree)
    return [f"core: {_core.__file__}", f"against Pinocchio on {robot.name}: {worst:.1e}"]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"
