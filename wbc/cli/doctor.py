"""``wbc doctor``: what runs on this machine, and why."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

import typer

from wbc import __version__
from wbc.cli.errors import errors_in_one_line

PACKAGES = ("pin", "coal", "proxsuite", "casadi", "numpy", "scipy", "mujoco")


def doctor() -> None:
    """Say what is installed, and whether ticks run in the native core or in Python, and why."""
    with errors_in_one_line():
        found = {name: _version(name) for name in PACKAGES}
        typer.echo(
            f"wbc {__version__}, Python {platform.python_version()}, "
            f"{platform.system()} {platform.machine()}"
        )
        typer.echo(", ".join(f"{name} {number}" for name, number in found.items()))
        for line in native_lines():
            typer.echo(line)


def native_lines() -> list[str]:
    """Return which path runs, and why; the core is compiled if it may be.

    Raises
    ------
    UnknownNameError
        No such value of ``WBC_NATIVE``.
    """
    from wbc.native import VARIABLE, mode, status
    from wbc.native.build import NativeCoreError, find_compiler

    wanted, found = mode(), status()
    path = "native core" if found.core is not None else "Python"
    lines = [f"ticks: {path}, {VARIABLE}={wanted}: {found.reason}"]
    try:
        lines.append(f"compiler: {' '.join(find_compiler())}")
    except NativeCoreError as error:
        lines.append(f"compiler: {error}")
    if found.core is not None:
        from wbc.robot import Robot
        from wbc.robot.kernel import NativeTree
        from wbc.robot.kernel_check import disagreement

        robot = Robot.load("hoap2_like")
        tree = NativeTree(found.core, robot.model)
        worst = disagreement(tree, robot.workspace)
        lines.append(f"against Pinocchio on {robot.name}: {worst:.1e}")
    if found.core is None and wanted == "require":
        lines.append("robots cannot be used: the core is required")
    return lines


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"
