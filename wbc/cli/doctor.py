"""Commands about the installation: ``doctor``, ``cache`` and, of a clone, ``bench``."""

from __future__ import annotations

import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated

import typer

from wbc import __version__

PACKAGES = ("cffi", "pin", "coal", "proxsuite", "casadi", "numpy", "scipy", "mujoco")

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


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

    Raises ModelError: too far.
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


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Delete all that is kept.")] = False,
) -> None:
    """Say where fitted shapes are kept, and how much; WBC_CACHE names another folder, or off."""
    from wbc.files import CACHE_VARIABLE, cache_folder

    folder = cache_folder()
    if folder is None:
        typer.echo(f"nothing is kept: {CACHE_VARIABLE}=off")
        return
    files = [file for file in folder.glob("*") if file.is_file()]
    size = sum(file.stat().st_size for file in files)
    if clear:
        for file in files:
            file.unlink(missing_ok=True)
    done = "deleted" if clear else "kept"
    typer.echo(f"{folder}: {len(files)} files, {size / 1e6:.1f} MB {done}")


def add_bench(app: typer.Typer) -> None:
    """Add the command: to measure, or without a clone to say where it is."""
    if (BENCHMARKS / "qpbench" / "command.py").is_file():
        sys.path.append(str(BENCHMARKS))
        from qpbench.command import BENCH_EXIT_CODES, bench

        app.command(epilog=BENCH_EXIT_CODES)(bench)
    else:
        app.command("bench", context_settings={"ignore_unknown_options": True})(without_clone)


def without_clone(
    arguments: Annotated[list[str] | None, typer.Argument(help="Not read here.")] = None,
) -> None:
    """Measure QP solvers on the QPs of controllers: in a clone of the repository."""
    from wbc.errors import InvalidInputError

    raise InvalidInputError(
        "wbc bench: the benchmarks are no part of the installed package; clone the repository,"
        " call make test there once, then .venv/bin/wbc bench"
    )
