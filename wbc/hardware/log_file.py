"""A log of the loop, read back: measurements, requests, answers and commands by cycle."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.files import read_arrays
from wbc.hardware.log_row import FAULTS, MODES, log_fields
from wbc.hardware.ring_log import FORMAT
from wbc.problem.problem import Problem, problem_of
from wbc.problem.provenance import files_of
from wbc.problem.saved import SavedRun
from wbc.problem.yaml_reader import parse
from wbc.robot.names import BASE
from wbc.run.history import History
from wbc.spatial import vech
from wbc.validate import Array

LARGEST = 4_000_000_000  # bytes unpacked: half an hour of a humanoid
TEXTS = ("events", "about", "made_of")


@dataclass(frozen=True, eq=False)
class HardwareLog:
    """A log that :class:`~wbc.hardware.loop.HardwareLoop` wrote."""

    path: Path  # its file
    arrays: Mapping[str, Array]  # a row for each cycle, oldest first, by the names of log_fields
    events: tuple[str, ...]  # changes of mode and first faults, in words
    about: str  # why it was written
    made_of: Mapping[str, Any]  # problem, profile, estimator and versions, as plain data
    problem: Problem  # the problem that ran

    @classmethod
    def load(cls, path: str | Path) -> HardwareLog:
        """Read a log.

        Raises InvalidInputError: not a log, damaged, or of another robot than its problem's;
        ProblemFileError: its problem cannot be loaded: robot or motion files are elsewhere, say.
        """
        path = Path(path)
        content = read_arrays(path, list, lambda name: "U" if name in TEXTS else "f", LARGEST)
        made_of = _made_of(path, content)
        ran = made_of["problem"]
        source = parse(str(ran["text"]), str(ran.get("file") or path))
        with files_of(path, source.name):
            problem = problem_of(source, dict(ran.get("overrides") or {}))
        if not isinstance(problem, Problem):
            raise InvalidInputError(f"{path}: of a pendulum's problem, which runs on no robot")
        arrays = {name: array for name, array in content.items() if name not in TEXTS}
        _check(path, arrays, problem)
        events = tuple(str(one) for one in np.atleast_1d(content["events"]) if str(one))
        return cls(path, arrays, events, str(content["about"]), made_of, problem)

    def rows(self) -> Iterator[dict[str, Array]]:
        """Yield the row of each cycle."""
        for k in range(len(self.arrays["time"])):
            yield {name: array[k] for name, array in self.arrays.items()}

    def as_run(self) -> SavedRun:
        """Return the rows with an estimate, as a run that can be drawn.

        Phases are the loop's modes; torques are measured.
        """
        arrays, robot = self.arrays, self.problem.parts.robot
        known = np.isfinite(arrays["q"]).all(axis=1) & np.isfinite(arrays["v"]).all(axis=1)
        if not known.any():
            raise InvalidInputError(f"{self.path}: has no estimate of the base, so nothing to draw")
        rows = {name: array[known] for name, array in arrays.items()}
        begins = arrays["time"][0]  # by the machine's clock, as the events
        time = rows["time"] - begins
        snapshots = [robot.snapshot(*state) for state in zip(rows["q"], rows["v"], strict=True)]
        count, none = len(time), np.full(len(time), np.nan)
        limits = robot.limits
        lower, upper = rows["position"] - limits.lower, limits.upper - rows["position"]
        history = History(
            time=time,
            phase=np.array([str(MODES[int(mode)]) for mode in rows["mode"]]),
            support=np.full(count, ""),
            q=rows["q"],
            v=rows["v"],
            com=np.array([one.com for one in snapshots]),
            inertia=np.array([vech(one.inertia) for one in snapshots]),
            margin=np.minimum(lower, upper).min(axis=1),
            balance=none,
            kkt=none,
            tick_time=none,
            tick_cpu_time=none,
            status=np.full(count, ""),
        )
        summary = {
            "format": FORMAT,
            "status": "logged",
            "reason": self.about,
            "robot": robot.name,
            "problem": self.made_of["problem"],
            "versions": self.made_of.get("versions", {}),
            "events": [*self._events(begins), *self._fault_counts()],
        }
        missing = np.full((count, 3), np.nan)
        up = np.array([one.rotation(BASE)[2, 2] for one in snapshots])
        simulation = {
            **{name: history.arrays()[name] for name in ("time", "q", "com")},
            "torque": rows["torque"],
            "tilt": np.arccos(np.clip(up, -1.0, 1.0)),
            "cop": missing,  # not measured
            "planned_cop": missing,
            "push": np.zeros((count, 3)),
            "relaxed": np.zeros(count, dtype=bool),
        }
        return SavedRun(self.path.stem, robot, history, summary, simulation)

    def _events(self, begins: float) -> Iterator[tuple[str, str]]:
        for event in self.events:
            when, _, what = event.partition(" ")
            try:
                yield f"{float(when) - begins:.4f} s", what
            except ValueError:
                told = f"{self.path}: array 'events': expected a time, got {when!r}"
                raise InvalidInputError(told) from None

    def _fault_counts(self) -> list[tuple[str, str]]:
        bits = self.arrays["faults"].astype(np.int64)
        counts = {str(one): int(((bits >> k) & 1).sum()) for k, one in enumerate(FAULTS)}
        return [(f"{count} cycles", name) for name, count in counts.items() if count]


def is_log(path: Path) -> bool:
    """Return whether an ``.npz`` is a log of the loop; False for unreadable files, too."""
    try:
        arrays = read_arrays(path, lambda names: [n for n in names if n == "made_of"],
                            lambda _: "U", LARGEST)  # fmt: skip
    except InvalidInputError:
        return False
    return "made_of" in arrays


def _made_of(path: Path, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    if any(name not in arrays for name in TEXTS):
        raise InvalidInputError(f"{path}: not a log of wbc hardware run")
    try:
        made_of = json.loads(str(arrays["made_of"]))
        is_known = made_of["format"] == FORMAT
        is_complete = is_known and isinstance(made_of["problem"]["text"], str)
    except (KeyError, TypeError, ValueError, RecursionError):
        is_complete = False
    if not is_complete:
        raise InvalidInputError(f"{path}: does not say what ran, as a {FORMAT!r} does")
    return dict(made_of)


def _check(path: Path, arrays: Mapping[str, NDArray[Any]], problem: Problem) -> None:
    robot = problem.parts.robot
    count = arrays["time"].shape[0] if "time" in arrays and arrays["time"].ndim == 1 else 0
    if not count:
        raise InvalidInputError(f"{path}: has no rows")
    if not (np.diff(arrays["time"]) > 0.0).all():
        raise InvalidInputError(f"{path}: array 'time': must increase from row to row")
    for name, size in log_fields(len(robot.joint_names), robot.nq, robot.nv).items():
        shape = (count,) if size == 1 else (count, size)
        if name not in arrays or arrays[name].shape != shape:
            got = arrays[name].shape if name in arrays else "none"
            raise InvalidInputError(f"{path}: array {name!r}: expected shape {shape}, got {got}")
    modes = arrays["mode"]
    if not (np.isin(modes, range(len(MODES))).all() and np.isfinite(arrays["faults"]).all()):
        raise InvalidInputError(f"{path}: arrays 'mode' and 'faults': damaged")
