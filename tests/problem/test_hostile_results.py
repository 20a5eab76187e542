"""Result files made to break a reader: each ends in a typed error, or in a report of what it says.

``WBC_FUZZ=3000`` tries as many damaged files of each kind instead of a few.
"""

import copy
import json
import os
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.damage import damaged
from tests.problem.loading import problem_of
from tests.texts import REACH, STAND
from wbc.errors import InvalidInputError, WbcError
from wbc.problem import load_problem
from wbc.problem.pendulum.result import SavedPendulum
from wbc.problem.saved import load_result
from wbc.view.mcap_export import write_mcap
from wbc.view.report import report as reports

COUNT = int(os.environ.get("WBC_FUZZ", "30"))
PENDULUM = """\
model: rmp_planar
mass: 35.0
start: {leg_length: 0.7, radii: 0.25, theta: 1.44}
bounds: {wheel_torque: 60.0, wheel_rate: 30.0}
law: {type: static_lean, angle: 1.43}
stop: {duration: 0.03}
"""
KINDS: dict[str, tuple[str, dict[str, float]]] = {
    "run": (REACH, {"stop.duration": 0.02}),
    "simulation": (STAND, {"simulation.duration": 0.02}),
    "pendulum": (PENDULUM, {}),
}
NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 1e20, 1e6, -1.0, 0.0)
JUNK = (None, 1, "x", [], {}, {"a": 1}, [1], -1, True, 10**400, float("inf"), float("nan"), [[]],
        {"a": {}}, 1e308, "\ud800", "a\0b", "</script>", "../../x", ["x"])  # fmt: skip
NAMES = ("obstacles/a/place", "obstacles/a/core", "obstacles/a/radius", "obstacles/a/normal",
         "clearance/x", "forces/left_sole", "active/x", "relaxed", "nearest/b", "errors/zz", "flat",
         "points/a", "targets/a", "support_0", "support_times")  # fmt: skip
SUMMARIES = ("[]", "1", "null", "{", '{"format": "wbc result 1"}', "[" * 100_000,
             '{"format": "wbc result 1", "status": "x", "robot": "../../etc/passwd"}')  # fmt: skip
Arrays = dict[str, np.ndarray[Any, Any]]


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reports, "DPI", 30)
        yield


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Arrays]:
    """Arrays of sound files, by kind."""
    folder, found = tmp_path_factory.mktemp("results"), {}
    for kind, (text, overrides) in KINDS.items():
        problem = problem_of(folder, text, overrides)
        result = problem.simulate() if kind == "simulation" else problem.run()
        result.save(folder / "r.npz")
        with np.load(folder / "r.npz") as file:
            found[kind] = dict(file)
    return found


def damage_summary(found: Any, rng: random.Random) -> None:
    """Change one entry, somewhere."""
    if isinstance(found, dict) and found:
        key, kind = rng.choice(list(found)), rng.random()
        if kind < 0.1:
            found.pop(key)
        elif kind < 0.2:
            found[rng.choice(["x", "", "\ud800", "a\0", "</script>"])] = found.pop(key)
        elif isinstance(found[key], dict | list) and kind < 0.8:
            damage_summary(found[key], rng)
        else:
            found[key] = rng.choice(JUNK)
    elif isinstance(found, list) and found:
        place = rng.randrange(len(found))
        if isinstance(found[place], dict | list):
            damage_summary(found[place], rng)
        else:
            found[place] = rng.choice(JUNK)


def damaged_arrays(arrays: Arrays, rng: random.Random) -> Arrays:
    """Return arrays of which a few are missing, of other shapes, types and values, or others'."""
    arrays, sound = dict(arrays), json.loads(str(arrays["summary"]))
    for _ in range(rng.choice([1, 1, 2, 3])):
        name, kind = rng.choice(list(arrays)), rng.randrange(11)
        array = arrays[name]
        if kind == 0:
            arrays.pop(name)
        elif kind == 1 and array.ndim:
            arrays[name] = array[: rng.choice([0, 1, 2])]
        elif kind == 2 and array.ndim == 2:
            arrays[name] = array[:, : rng.choice([0, 1, 2, 5])]
        elif kind == 3:
            arrays[name] = array[None] if rng.random() < 0.5 else array[..., None]
        elif kind == 4 and array.dtype.kind == "f" and array.size:
            arrays[name] = array.copy()
            arrays[name].flat[rng.randrange(array.size)] = rng.choice(NUMBERS)
        elif kind == 5 and array.dtype.kind == "f":
            with np.errstate(over="ignore"):
                arrays[name] = array * rng.choice([0.0, 1e300, 1e25, 1e7, -1.0, 1e-300])
        elif kind == 6:
            arrays[name] = np.zeros(array.shape, rng.choice(["f4", "i8", "U5", "f2", "S3", "?"]))
        elif kind == 7:
            places = (np.zeros((4, 3)), np.zeros((5, 3, 4)), np.array(1.0), np.full(3, np.nan))
            arrays[rng.choice(NAMES)] = rng.choice((array, *places))
        elif kind == 8:
            arrays["summary"] = np.array(rng.choice(SUMMARIES))
        else:
            summary = copy.deepcopy(sound)
            damage_summary(summary, rng)
            arrays["summary"] = np.array(json.dumps(summary))
    return arrays


def outcome(path: Path, beside: Path) -> WbcError | None:
    """Read a file and write what is made of it; only typed errors pass, all on a few lines."""
    try:
        saved = load_result(path)
        if isinstance(saved, SavedPendulum):
            reports.write_pendulum_report(saved.history, saved.summary, beside, title="x")
        else:
            told = saved.robot, saved.history, saved.summary
            parts = {"simulation": saved.simulation, "terrain": saved.terrain}
            reports.write_report(*told, beside, title="x", **parts)
            write_mcap(*told, beside.with_suffix(".mcap"), simulation=saved.simulation)
    except WbcError as error:
        assert len(str(error)) < 3000
        return error
    return None


def fuzz(arrays: Arrays, folder: Path, seed: int, count: int) -> int:
    """Return how many of some damaged files are refused."""
    refused, path = 0, folder / "m.npz"
    for k in range(count):
        rng = random.Random(1000 * seed + k)
        np.savez(path, **damaged_arrays(arrays, rng))
        if rng.random() < 0.1:
            path.write_bytes(damaged(path.read_bytes(), rng))
        refused += outcome(path, folder / "r.html") is not None
    return refused


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Matplotlib: numbers that fit into no axes
@pytest.mark.parametrize("kind", KINDS)
def test_damaged_results_are_refused_or_reported(kind, results, tmp_path) -> None:
    count = max(COUNT // 3, 1)
    refused = fuzz(results[kind], tmp_path, list(KINDS).index(kind), count)
    assert count // 4 < refused < count  # hostile, and not refused for being one of its kind


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_sound_results_are_reported(kind: str, results: dict[str, Arrays], tmp_path: Path) -> None:
    np.savez(tmp_path / "r.npz", **results[kind])
    assert outcome(tmp_path / "r.npz", tmp_path / "r.html") is None


FAULTS = {
    "tasks.hand.norm": ("x", "tasks.hand.norm: input should be a valid number"),
    "tasks.hand.units": (3, "tasks.hand.units: input should be a valid list"),
    "tasks": (None, "tasks: input should be a valid dictionary"),
    "constraints.room.at": ("\ud800", "not the result of a run"),
    "tick_time.wall.median": ({}, "tick_time.wall.median: input should be"),
    "status": (None, "status: input should be a valid string"),
    "problem.text": ([], "problem.text: input should be a valid string"),
}


@pytest.mark.parametrize("where", FAULTS)
def test_damage_of_a_summary_is_named(where, results, tmp_path) -> None:
    value, said = FAULTS[where]
    arrays = copy.copy(results["run"])
    summary = part = json.loads(str(arrays["summary"]))
    *path, last = where.split(".")
    for key in path:
        part = part[key]
    assert last in part
    part[last] = value
    arrays["summary"] = np.array(json.dumps(summary))
    np.savez(tmp_path / "r.npz", **arrays)
    with pytest.raises(InvalidInputError, match=said):
        load_result(tmp_path / "r.npz")


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("time", lambda time: time[::-1], "do not fall"),
        ("time", lambda time: 1e12 * time, "do not fall"),
        ("q", lambda q: q[:, :-1], "expected shape"),
        ("q", lambda q: np.full_like(q, np.nan), "has NaN"),
        ("com", lambda com: 1e300 * com, "beyond"),
        ("errors/hand", lambda errors: errors[1:], "rows"),
        ("obstacles/room/wall/place", lambda place: place[1:], "rows"),
        ("obstacles/room/ball/radius", lambda radius: -radius, "radius"),
    ],
)
def test_damage_of_an_array_is_named(name, change, said, results, tmp_path) -> None:
    np.savez(tmp_path / "r.npz", **{**results["run"], name: change(results["run"][name])})
    with pytest.raises(InvalidInputError, match=said):
        load_result(tmp_path / "r.npz")


def test_a_file_of_another_kind_is_told_from_a_damaged_one(tmp_path: Path) -> None:
    path = tmp_path / "walk.npz"
    told = json.dumps({"format": "wbc retargeted motion 1"})
    np.savez(path, feet=np.array(["left", "right"]), summary=np.array(told))
    with pytest.raises(InvalidInputError, match="is a 'wbc retargeted motion 1', not a"):
        load_result(path)
    with pytest.raises(WbcError, match="no problem file, but a packed one"):
        load_problem(path)
