"""Results read back from files: the robot and the history of a run, to be drawn again."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from wbc.errors import InvalidInputError, WbcError
from wbc.files import read_arrays
from wbc.problem.overrides import apply_overrides
from wbc.problem.pendulum.result import FORMAT as PENDULUM_FORMAT
from wbc.problem.pendulum.result import SavedPendulum
from wbc.problem.reading import parse
from wbc.problem.robot_spec import RobotSpec
from wbc.problem.walk import read_problem
from wbc.robot import Robot
from wbc.run.history import History
from wbc.run.obstacles import ObstacleTrack
from wbc.run.result import FORMAT, Result
from wbc.simulation import SimulationResult, Terrain
from wbc.simulation.terrain import LEVEL

LARGEST = 2_000_000_000  # bytes of all arrays unpacked
WORDS = ("phase", "support", "status", "nearest", "summary", "joint_names")
ANSWERS = ("active", "relaxed", "flat")  # yes or no
FORMATS = (FORMAT, PENDULUM_FORMAT)
REMEDY = "make it by: wbc run PROBLEM.yaml -o result.npz"
# What reading and drawing raise where a file is not what it should be.
DAMAGE = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)


@dataclass(frozen=True, eq=False)
class SavedRun:
    """A run, as it was or as its file tells."""

    name: str  # what to call it
    robot: Robot
    history: History  # every tick
    summary: Mapping[str, Any]  # what Result.summary returned, with the problem's text and versions
    # Of a simulation, the arrays that SimulationResult.save writes.
    simulation: Mapping[str, NDArray[Any]] | None = None
    terrain: Terrain = LEVEL  # of a simulation, what the robot stood on

    @classmethod
    def of(cls, result: Result | SimulationResult, name: str) -> SavedRun:
        """Return what a file with the result would give."""
        if isinstance(result, Result):
            return cls(name, result.robot, result.history, result.summary())
        arrays = result.arrays
        parts = result.robot, _history(arrays), result.summary()
        return cls(name, *parts, arrays, result.terrain)


def load_result(path: str | Path, robot: Robot | None = None) -> SavedRun | SavedPendulum:
    """Read an ``.npz`` that ``wbc run`` or ``wbc sim`` has written.

    Parameters
    ----------
    robot:
        By default that of the problem, of which the file holds the text.

    Raises
    ------
    InvalidInputError
        Not such a file, or for another robot.
    ProblemFileError
        The problem's text names no robot that can be loaded.
    ModelError
        The robot's files are not there any more.
    """
    path = Path(path)
    # First of all what it is: arrays of other files are not to blame for it.
    summary = _summary(path, read_arrays(path, _summary_alone, _kinds, LARGEST))
    arrays = read_arrays(path, list, _kinds, LARGEST)
    if summary["format"] == PENDULUM_FORMAT:
        if robot is not None:
            raise InvalidInputError(f"{path}: a pendulum's result, which has no robot to name")
        with damage_told(path):
            return SavedPendulum.of_arrays(path.stem, arrays, summary)
    if robot is None:
        robot = _robot_of(path, summary)
    names = tuple(str(name) for name in arrays.get("joint_names", ()))
    if names != robot.joint_names:
        raise InvalidInputError(
            f"{path}: its joints are not those of {robot.name}; name its robot with --robot, or "
            + REMEDY
        )
    with damage_told(path):
        terrain = _terrain(summary)
        simulation = arrays if "simulation" in summary else None
        return SavedRun(path.stem, robot, _history(arrays), summary, simulation, terrain)


@contextmanager
def damage_told(path: str | Path) -> Iterator[None]:
    """Raise InvalidInputError for what a file lacks, or is damaged in, as it is read or drawn."""
    try:
        yield
    except WbcError:
        raise
    except DAMAGE as error:
        what = "lacks" if isinstance(error, KeyError) else "damaged:"
        raise InvalidInputError(f"{path}: {what} {error!s:.200}; {REMEDY}") from error


def _summary_alone(names: Iterable[str]) -> list[str]:
    return [name for name in names if name == "summary"]


def _kinds(name: str) -> str:
    first = name.partition("/")[0]
    return "U" if first in WORDS else "b" if first in ANSWERS else "f"


def _summary(path: Path, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    return read_summary(path, str(arrays.get("summary", "")))


def read_summary(path: Path, text: str) -> dict[str, Any]:
    """Return the summary in a result's file.

    Raises
    ------
    InvalidInputError
        No JSON, or not of a result.
    """
    try:
        summary = dict(json.loads(text))
        found = summary["format"]
    except DAMAGE as error:
        raise InvalidInputError(f"{path}: not the result of a run; {REMEDY}") from error
    if found not in FORMATS:
        known = " or ".join(map(repr, FORMATS))
        raise InvalidInputError(f"{path}: is a {found!r:.40}, not a {known}; {REMEDY}")
    return summary


def _robot_of(path: Path, summary: Mapping[str, Any]) -> Robot:
    """Return the robot of the problem that a result came from."""
    made_from = summary.get("problem")
    if not isinstance(made_from, Mapping):
        name = str(summary.get("robot", ""))
        try:
            return Robot.load(name)
        except WbcError as error:
            what = f"{path}: does not say which file its robot {name!r} came from; give it: --robot"
            raise InvalidInputError(what) from error
    source = parse(str(made_from.get("text", "")), str(made_from.get("file", path)))
    spec = read_problem(apply_overrides(source, made_from.get("overrides") or {}))
    robot = RobotSpec(model=spec.robot) if isinstance(spec.robot, str) else spec.robot
    return robot.load(Path(source.name).parent)


def _terrain(summary: Mapping[str, Any]) -> Terrain:
    """Return what a simulated robot stood on; level ground where an older file does not say it."""
    told = summary.get("simulation", {}).get("terrain")
    return LEVEL if told is None else Terrain.from_data(told)


def _history(arrays: Mapping[str, NDArray[Any]]) -> History:
    values: dict[str, Any] = {}
    for field in fields(History):
        if not str(field.type).startswith("Mapping"):
            values[field.name] = arrays[field.name]
            continue
        begin = f"{field.name}/"
        group = {
            name.removeprefix(begin): array
            for name, array in arrays.items()
            if name.startswith(begin)
        }
        values[field.name] = _tracks(group) if field.name == "obstacles" else group
    return History(**values)


def _tracks(group: Mapping[str, NDArray[Any]]) -> dict[str, ObstacleTrack]:
    """Return tracks from arrays such as ``room/wall/place``."""
    parts: dict[str, dict[str, NDArray[Any]]] = {}
    for name, array in group.items():
        obstacle, _, part = name.rpartition("/")
        parts.setdefault(obstacle, {})[part] = array
    return {name: ObstacleTrack.from_arrays(arrays) for name, arrays in parts.items()}
