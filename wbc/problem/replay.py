"""Replay of a recorded run from its file, compared to the last bit."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError, listed
from wbc.files import read_arrays
from wbc.problem.problem import Problem, problem_of
from wbc.problem.provenance import files_of
from wbc.problem.saved import FORMATS, LARGEST
from wbc.problem.saved_parts import read_summary
from wbc.problem.yaml_reader import parse
from wbc.run.simulate import Cancelled, Progress

# Entries of a result that differ from run to run: timings, and the number of workers.
TIMINGS = ("tick_time", "tick_cpu_time", "seconds", "build_seconds", "search_seconds", "workers")
# Reported but not compared: they are inputs.
NOT_COMPARED = ("versions", "problem")


class RunReplay(NamedTuple):
    """The comparison of a recorded run with its replay."""

    ticks: int  # number of ticks compared, from the first on; 0: only the summary
    differences: tuple[str, ...]  # entries that differ in any bit, in words; empty if none
    versions: tuple[str, ...]  # packages whose versions differ, in words
    # whether the summary was compared, too: not if it or the replay was interrupted
    whole: bool = True

    @property
    def same(self) -> bool:
        """Whether everything that was compared is the same to the last bit."""
        return not self.differences


def replay_run(
    path: str | Path, progress: Progress | None = None, cancelled: Cancelled | None = None
) -> RunReplay:
    """Repeat the run of a result's ``.json`` or ``.npz``, and compare.

    The file holds the problem's text and its overrides. All arrays (of an ``.npz``) and the whole
    summary are compared except timings; of an interrupted run its recorded ticks.

    Raises InvalidInputError: not a result, or damaged; or the ``.json`` of an interrupted run,
    without its ticks; ProblemFileError: its problem cannot be loaded, for instance because robot or
    motion files have moved.
    """
    path = Path(path)
    summary, arrays = read_result(path)
    whole = summary.get("status") != "interrupted"
    if not whole and not arrays:
        raise InvalidInputError(
            f"{path}: the summary of an interrupted run: only its ticks can be compared, and they "
            "are in its .npz"
        )
    made_of = summary.get("problem")
    if not isinstance(made_of, Mapping):
        raise InvalidInputError(f"{path}: does not hold the problem that it came from")
    name, text = str(made_of.get("file") or path), str(made_of.get("text", ""))
    with files_of(path, name):
        problem = problem_of(parse(text, name), dict(made_of.get("overrides") or {}))
    with tempfile.TemporaryDirectory(prefix="wbc-") as folder:
        again = Path(folder) / f"again{path.suffix.lower()}"
        result: Any
        after = 0  # rows after the last tick's, which repeat it
        if isinstance(problem, Problem) and problem.spec.controller.level == "torque":
            result, after = problem.simulate(progress, cancelled=cancelled), 1
        else:
            result = problem.run(progress, cancelled=cancelled)
        result.save(again)
        now, now_arrays = read_result(again)
    ticks = min((len(a["time"]) for a in (arrays, now_arrays) if "time" in a), default=0)
    whole = whole and now.get("status") != "interrupted"
    if not whole:
        ticks = max(ticks - after, 0)
    found = list(_array_differences(arrays, now_arrays, ticks))
    if whole:
        found += _differences(summary, now, "")
    return RunReplay(ticks, tuple(found), _other_versions(summary, now), whole)


def read_result(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the summary in a result's file, and its arrays; a ``.json`` has none."""
    if path.suffix.lower() == ".npz":
        arrays = read_arrays(path, list, lambda _: "Ubfiu", LARGEST)
        text = str(arrays.pop("summary", ""))
        summary, times = read_summary(path, text, FORMATS), arrays.get("time")
        if times is not None and times.ndim != 1:
            raise InvalidInputError(f"{path}: time: expected a row of times, got {times.shape}")
        return summary, arrays
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{path}: neither a result nor a saved tick") from error
    return read_summary(path, text, FORMATS), {}


def _array_differences(
    before: Mapping[str, NDArray[Any]], now: Mapping[str, NDArray[Any]], ticks: int
) -> list[str]:
    found = []
    whole = len(before.get("time", ()))
    for name, one in before.items():
        if name.partition("/")[0] in TIMINGS:
            continue
        old, new = one, now.get(name)
        if new is None:
            if not name.startswith("active/") or old[:ticks].any():  # it may become active later
                found.append(f"{name}: is not there any more")
            continue
        if one.ndim and len(old) == whole:  # a row per tick
            old, new = old[:ticks], new[:ticks]
        if old.shape != new.shape:
            found.append(f"{name}: shape {old.shape}, now {new.shape}")
        elif name == "meta":  # of a plan, as JSON
            found += _differences(json.loads(str(old)), json.loads(str(new)), name)
        elif old.dtype.kind in "US":
            if not np.array_equal(old, new):
                found.append(f"{name}: other words")
        elif old.tobytes() != new.tobytes():
            found.append(f"{name}{_first_difference(old, new)}")
    return found


def _first_difference(old: NDArray[Any], new: NDArray[Any]) -> str:
    """Return the first row in which two arrays differ, and the largest difference, in words."""
    both = old.astype(float), new.astype(float)
    differs = ~np.isclose(*both, rtol=0.0, atol=0.0, equal_nan=True)
    row = int(np.argwhere(differs)[0][0]) if differs.any() and old.ndim else 0
    by = float(np.nanmax(np.abs(both[0] - both[1]), initial=0.0))
    return f": from tick {row} on, by at most {by:.3g}"


def _differences(before: Any, now: Any, where: str) -> list[str]:
    """Return the entries of a summary that differ, in words."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        found = []
        for key in before:
            if key not in TIMINGS and not (key in NOT_COMPARED and not where):
                inner = f"{where}.{key}" if where else str(key)
                found += _differences(before[key], now.get(key), inner)
        return found
    if json.dumps(before) == json.dumps(now):
        return []
    if isinstance(before, list) or isinstance(now, list):
        return [f"{where}: another list"]
    return [f"{where}: was {before}, is {now}"]


def _other_versions(before: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[str, ...]:
    was, here = before.get("versions") or {}, now.get("versions") or {}
    return tuple(
        f"{name} {was[name]}, here {here.get(name)}" for name in was if was[name] != here.get(name)
    )


def describe_replay(replay: RunReplay) -> str:
    """Return the result of a replay, in words."""
    ticks = f"{replay.ticks} ticks"
    what = f"{ticks} and the summary" if replay.ticks else "the summary"
    if not replay.whole:
        what = f"{ticks} until the interruption"
    if replay.same:
        return f"{what}: the same to the last bit"
    reasons = f"; versions differ: {', '.join(replay.versions)}" if replay.versions else ""
    return f"{what}: not the same: {listed(replay.differences, 6)}{reasons}"
