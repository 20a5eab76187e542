"""Results read back from files: robot and history of a run, for drawing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from wbc.errors import InvalidInputError, ModelError, WbcError
from wbc.files import read_arrays
from wbc.problem.overrides import apply_overrides
from wbc.problem.pendulum.result import FORMAT as PENDULUM_FORMAT
from wbc.problem.pendulum.result import SavedPendulum, motion_names, pendulum_of
from wbc.problem.provenance import files_of
from wbc.problem.robot_spec import RobotSpec
from wbc.problem.saved_parts import REMEDY, check_arrays, read_summary
from wbc.problem.walk import read_problem
from wbc.problem.yaml_reader import parse
from wbc.robot import Robot
from wbc.run.history import History
from wbc.run.obstacles import ObstacleTrack
from wbc.run.result import FORMAT, Result
from wbc.simulation import SimulationResult, Terrain
from wbc.simulation.terrain import LEVEL

LARGEST = 2_000_000_000  # bytes of all arrays unpacked
WORDS = ("phase", "support", "status", "nearest", "clearance_unit", "summary", "joint_names")
FLAGS = ("active", "relaxed", "flat")  # yes or no
FORMATS = (FORMAT, PENDULUM_FORMAT)


@dataclass(frozen=True, eq=False)
class SavedRun:
    """A run, finished in this process or read from its file."""

    name: str
    robot: Robot
    history: History  # every tick
    summary: Mapping[str, Any]  # what Result.summary returned, with the problem's text and versions
    # Of a simulation, the arrays that SimulationResult.save writes.
    simulation: Mapping[str, NDArray[Any]] | None = None
    terrain: Terrain = LEVEL  # of a simulation, what the robot stood on

    @classmethod
    def of(cls, result: Result | SimulationResult, name: str) -> SavedRun:
        """Return the saved run of a result in memory."""
        if isinstance(result, Result):
            return cls(name, result.robot, result.history, result.summary())
        arrays = result.arrays
        parts = result.robot, _history(arrays), result.summary()
        return cls(name, *parts, arrays, result.terrain)


def load_result(path: str | Path, robot: Robot | None = None) -> SavedRun | SavedPendulum:
    """Read an ``.npz`` that ``wbc run`` or ``wbc sim`` has written.

    ``robot``: by default the problem's, whose text is in the file.

    Raises InvalidInputError: not such a file, or for another robot; ProblemFileError: the problem's
    text names no robot that can be loaded; ModelError: the robot's files are not there any more.
    """
    path = Path(path)
    # Check the format first, so that other files are not reported as damaged.
    alone = read_arrays(path, {"summary"}.intersection, _kinds, LARGEST)
    if not alone:
        raise InvalidInputError(f"{path}: not the result of a run; {REMEDY}")
    summary = read_summary(path, str(alone["summary"]), FORMATS)
    pendulum = summary["format"] == PENDULUM_FORMAT
    arrays = read_arrays(path, motion_names if pendulum else list, _kinds, LARGEST)
    if pendulum:
        if robot is not None:
            raise InvalidInputError(f"{path}: a pendulum's result, which has no robot to name")
        return pendulum_of(path, arrays, summary)
    if robot is None:
        robot = _robot_of(path, summary)
    names = tuple(str(name) for name in arrays.get("joint_names", ()))
    if names != robot.joint_names:
        raise InvalidInputError(
            f"{path}: its joints are not those of {robot.name}; name its robot with --robot, or "
            + REMEDY
        )
    check_arrays(path, robot, arrays)
    try:
        history = _history(arrays)
    except KeyError as error:
        raise InvalidInputError(f"{path}: lacks the array {error}; {REMEDY}") from None
    except (InvalidInputError, ModelError) as error:
        raise InvalidInputError(f"{path}: {error}; {REMEDY}") from error
    simulation = arrays if "simulation" in summary else None
    return SavedRun(path.stem, robot, history, summary, simulation, _terrain(path, summary))


def _kinds(name: str) -> str:
    first = name.partition("/")[0]
    return "U" if first in WORDS else "b" if first in FLAGS else "f"


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
    with files_of(path, source.name):
        return robot.load(Path(source.name).parent)


def _terrain(path: Path, summary: Mapping[str, Any]) -> Terrain:
    """Return what a simulated robot stood on; level ground where an older file does not say it."""
    try:
        told = summary.get("simulation", {}).get("terrain")
        return LEVEL if told is None else Terrain.from_data(told)
    except (AttributeError, KeyError, TypeError, InvalidInputError) as error:
        raise InvalidInputError(f"{path}: its terrain cannot be read; {REMEDY}") from error


def _history(arrays: Mapping[str, NDArray[Any]]) -> History:
    values: dict[str, Any] = {}
    for field in fields(History):
        if field.name in arrays:
            values[field.name] = arrays[field.name]
        else:
            begin = f"{field.name}/"
            group = {
                name.removeprefix(begin): array
                for name, array in arrays.items()
                if name.startswith(begin)
            }
            values[field.name] = (
                _tracks(group, arrays["time"].size) if field.name == "obstacles" else group
            )
    return History(**values)


def _tracks(group: Mapping[str, NDArray[Any]], count: int) -> dict[str, ObstacleTrack]:
    """Return tracks from arrays such as ``room/wall/place``."""
    parts: dict[str, dict[str, NDArray[Any]]] = {}
    for name, array in group.items():
        obstacle, _, part = name.rpartition("/")
        parts.setdefault(obstacle, {})[part] = array
    try:
        tracks = {name: ObstacleTrack.from_arrays(arrays) for name, arrays in parts.items()}
    except KeyError as error:
        raise InvalidInputError(f"an obstacle lacks the array {error}") from error
    for name, track in tracks.items():
        if len(track.place) != count:
            what = f"expected {count} rows, got {len(track.place)}"
            raise InvalidInputError(f"place of obstacle {name[:60]!r}: {what}")
    return tracks
