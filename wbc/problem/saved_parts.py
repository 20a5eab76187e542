"""Checks of a result file's summary and arrays when they are read.

A file may be damaged, or written by another program; entries that are not read are not checked.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from wbc.errors import InvalidInputError, listed
from wbc.robot import Robot

Real = Annotated[float, Field(strict=True)]
Number = Real | None  # what is not finite is written as null
Text = Annotated[str, Field(strict=True)]
REMEDY = "make it by: wbc run PROBLEM.yaml -o result.npz"
SEE_MOTION = (
    "to see it: wbc analyze MOTION.npz --robot ROBOT --plot motion.png, wbc retarget --view"
)
LONGEST = 1e9  # s, of a run: nanoseconds of it fit into 64 bits
LARGEST = 1e30  # of any number, in its unit: what is drawn is squared, and written as 32 bits
# Arrays of one row per tick, and the shapes of a row; others may have any number of entries.
ROW_SHAPES = {
    "com": (3,), "inertia": (6,), "task_inertia": (6,), "points": (3,), "targets": (3,),
    "cop": (3,), "planned_cop": (3,), "push": (3,), "forces": (6,), "planned_forces": (6,),
    "wrenches": (6,),
    "plan_com": (3,), "plan_cop": (3,), "plan_momentum": (3,), "angular_momentum": (3,),
    "time": (), "phase": (), "support": (), "status": (), "slip": (), "turn": (), "margin": (),
    "balance": (), "clearance": (), "clearance_unit": (), "nearest": (), "active": (), "kkt": (),
    "tick_time": (), "tick_cpu_time": (), "relaxed": (), "tilt": (), "cop_margin": (),
}  # fmt: skip
ANY_SHAPE = ("errors",)
# Arrays of every run; others depend on its tasks, contacts and constraints.
REQUIRED = (
    "time", "phase", "support", "q", "v", "com", "inertia", "margin", "balance", "kkt", "tick_time",
    "tick_cpu_time", "status",
)  # fmt: skip
FINITE = ("time", "q", "v", "com", "inertia")  # in each tick; others may be NaN
MAY_BE_INFINITE = "margin"  # infinite where no joint has a range


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow")


class _Problem(_Part):
    text: Text
    file: Text | None = None
    overrides: dict[str, Any] | None = None


class _Task(_Part):
    norm: Number
    units: list[Text]
    tolerance: Number
    rows: list[Text] = []


class _Constraint(_Part):
    least_clearance: Number
    unit: Text = "m"
    time: Number
    at: Any


class _HeldBack(_Part):
    ticks: Annotated[int, Field(strict=True, gt=0)]
    seconds: Real
    first: Real
    last: Real


class _Times(_Part):
    median: Number
    p99: Number
    max: Number


class _Push(_Part):
    impulse: list[Real]
    body: Text
    at: Real


class _Simulation(_Part):
    pushes: list[_Push] = []
    relaxed: Number = None
    least_cop_margin: Number = None
    peak_tilt: Number = None
    lost_frames: Number = None
    saturated: dict[str, Real] = {}
    notes: list[Text] = []
    terrain: dict[str, Any] | None = None


class _Summary(_Part):
    format: Text
    status: Text
    problem: _Problem | None = None
    measures: dict[str, Number] = {}
    simulation: _Simulation = _Simulation()
    tasks: dict[str, _Task] = {}
    constraints: dict[str, _Constraint] = {}
    held_back: dict[str, _HeldBack] = {}
    tick_time: dict[str, _Times] = {}
    versions: dict[str, Text] = {}


def read_summary(path: Path, text: str, formats: Collection[str]) -> dict[str, Any]:
    """Return the summary in a result's file, which must have one of the given formats.

    Raises InvalidInputError: not JSON, or entries of the wrong type: all are named.
    """
    try:
        summary = json.loads(text)
        json.dumps(summary, ensure_ascii=False).encode()  # JSON has strings that are no text
        found = summary["format"]
        if found not in formats:
            known = " or ".join(map(repr, formats))
            remedy = SEE_MOTION if str(found).startswith("wbc retargeted motion") else REMEDY
            raise InvalidInputError(f"{path}: is a {found!r:.40}, not a {known}; {remedy}")
        _Summary.model_validate(summary)
    except ValidationError as error:
        wrong = [
            f"{'.'.join(map(str, one['loc'])) or 'all of it'}: {one['msg'].lower()}"
            for one in error.errors(include_url=False, include_input=False)
        ]
        what = f"{path}: its summary is damaged ({listed(wrong, 3):.300}); {REMEDY}"
        raise InvalidInputError(what) from error
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InvalidInputError(f"{path}: not the result of a run; {REMEDY}") from error
    return dict(summary)


def check_arrays(path: Path, robot: Robot, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Refuse arrays of a run, or a simulation, that do not fit the robot and each other.

    Raises InvalidInputError: the first that is missing, not of its shape, or has numbers that no
    run has.
    """
    for name in REQUIRED:
        if name not in arrays:
            raise InvalidInputError(f"{path}: lacks the array {name!r}; {REMEDY}")
    count = arrays["time"].size
    joints = len(robot.joint_names)
    shapes = {**ROW_SHAPES, "q": (robot.nq,), "v": (robot.nv,), "torque": (joints,)}
    for name, array in arrays.items():
        kind = name.partition("/")[0]
        if kind in shapes and array.shape != (count, *shapes[kind]):
            fault = f"expected shape {(count, *shapes[kind])}, got {array.shape}"
        elif kind in ANY_SHAPE and (array.ndim not in (1, 2) or len(array) != count):
            fault = f"expected {count} rows, got shape {array.shape}"
        else:
            numbers = array[array != np.inf] if name == MAY_BE_INFINITE else array
            fault = damaged_numbers(numbers, name in FINITE)
        if fault:
            raise InvalidInputError(f"{path}: array {name[:60]!r}: {fault}; {REMEDY}")
    check_times(path, arrays["time"])


def damaged_numbers(array: NDArray[Any], known: bool) -> str:
    """Return what is wrong with an array's numbers, in words; empty if nothing.

    ``known``: whether NaN (no value) is wrong too.
    """
    if array.dtype.kind != "f":
        return ""
    if known and np.isnan(array).any():
        return "has NaN"
    if (np.abs(array.astype(np.float64)) > LARGEST).any():
        return f"has numbers beyond {LARGEST:g}"
    return ""


def check_times(path: Path, time: NDArray[Any]) -> None:
    """Refuse times (n,) [s] that decrease, or are longer than any run."""
    if not time.size:
        raise InvalidInputError(f"{path}: array 'time': is empty; {REMEDY}")
    if time[0] < 0.0 or time[-1] > LONGEST or (np.diff(time) < 0.0).any():
        what = f"expected times from 0 to {LONGEST:g} s that do not fall"
        raise InvalidInputError(f"{path}: array 'time': {what}; {REMEDY}")
