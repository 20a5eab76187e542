"""The arrays in a result's file: whether they fit together, before anything is drawn of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.problem.saved_summary import REMEDY
from wbc.robot import Robot

LONGEST = 1e9  # s, of a run: nanoseconds of it fit into 64 bits
LARGEST = 1e30  # of any number, in its unit: what is drawn is squared, and written as 32 bits
# Arrays of one row per tick, and the shapes of a row; others may have any number of entries.
ROWS = {
    "com": (3,), "inertia": (6,), "task_inertia": (6,), "points": (3,), "targets": (3,),
    "cop": (3,), "planned_cop": (3,), "push": (3,), "forces": (6,), "planned_forces": (6,),
    "wrenches": (6,),
    "plan_com": (3,), "plan_cop": (3,), "plan_momentum": (3,), "angular_momentum": (3,),
    "time": (), "phase": (), "support": (), "status": (), "slip": (), "turn": (), "margin": (),
    "balance": (), "clearance": (), "nearest": (), "active": (), "kkt": (), "tick_time": (),
    "tick_cpu_time": (), "relaxed": (), "tilt": (), "cop_margin": (),
}  # fmt: skip
ANY = ("errors",)
# What each run has; the rest depends on its tasks, contacts and constraints.
NEEDED = (
    "time", "phase", "support", "q", "v", "com", "inertia", "margin", "balance", "kkt", "tick_time",
    "tick_cpu_time", "status",
)  # fmt: skip
KNOWN = ("time", "q", "v", "com", "inertia")  # in each tick; others may be NaN


def check_arrays(path: Path, robot: Robot, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Refuse arrays of a run, or a simulation, that do not fit the robot and each other.

    Raises
    ------
    InvalidInputError
        The first that is missing, not of its shape, or has numbers that no run has.
    """
    for name in NEEDED:
        if name not in arrays:
            raise InvalidInputError(f"{path}: lacks the array {name!r}; {REMEDY}")
    count = arrays["time"].size
    joints = len(robot.joint_names)
    shapes = {**ROWS, "q": (robot.nq,), "v": (robot.nv,), "torque": (joints,)}
    for name, array in arrays.items():
        kind = name.partition("/")[0]
        if kind in shapes and array.shape != (count, *shapes[kind]):
            fault = f"expected shape {(count, *shapes[kind])}, got {array.shape}"
        elif kind in ANY and (array.ndim not in (1, 2) or len(array) != count):
            fault = f"expected {count} rows, got shape {array.shape}"
        else:
            fault = damaged_numbers(array, name in KNOWN)
        if fault:
            raise InvalidInputError(f"{path}: array {name[:60]!r}: {fault}; {REMEDY}")
    check_times(path, arrays["time"])


def damaged_numbers(array: NDArray[Any], known: bool) -> str:
    """Return what is wrong with numbers; empty if nothing is, as with words.

    Parameters
    ----------
    known:
        Whether NaN, which says that there is nothing, is wrong too.
    """
    if array.dtype.kind != "f":
        return ""
    if known and np.isnan(array).any():
        return "has NaN"
    if (np.abs(array.astype(np.float64)) > LARGEST).any():
        return f"has numbers beyond {LARGEST:g}"
    return ""


def check_times(path: Path, time: NDArray[Any]) -> None:
    """Refuse times (n,) [s] that fall, or that no run lasts."""
    if not time.size:
        raise InvalidInputError(f"{path}: array 'time': is empty; {REMEDY}")
    if time[0] < 0.0 or time[-1] > LONGEST or (np.diff(time) < 0.0).any():
        what = f"expected times from 0 to {LONGEST:g} s that do not fall"
        raise InvalidInputError(f"{path}: array 'time': {what}; {REMEDY}")
