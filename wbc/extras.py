"""Optional packages, each installed by one of this package's extras."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

from wbc.errors import MissingPackageError

EXTRAS = {
    "cyclonedds": "unitree",
    "distributed": "cluster",
    "foxglove": "foxglove",
    "matplotlib": "plot",
    "mcap": "mcap",
    "mujoco": "sim",
    "mujoco_menagerie": "menagerie",
    "pandas": "frames",
    "pyarrow": "batch",
    "rerun": "rerun",
    "robot_descriptions": "descriptions",
    "viser": "view",
}


def installed(package: str) -> bool:
    """Return whether a package is installed, without loading it."""
    try:
        return find_spec(package) is not None
    except ValueError:  # another module was put in its place
        return False


def require(package: str, what: str) -> None:
    """Raise MissingPackageError if a package that ``what`` needs is not installed."""
    if not installed(package):
        raise MissingPackageError(f"{what} needs {package}: pip install 'wbc[{EXTRAS[package]}]'")


@contextmanager
def quietly(mujoco: Any) -> Iterator[None]:
    """Raise MuJoCo's warnings as errors, instead of printing them and writing a log file."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
