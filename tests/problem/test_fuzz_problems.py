"""Mutated problem files and plan files: whatever they hold, only a WbcError may come out.

A few hundred inputs by default; ``WBC_FUZZ=N`` tries N of each kind. A seed reproduces its input.
"""

import copy
import json
import math
import os
import random
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from tests.damage import damaged
from tests.problem.loading import problem_of
from wbc.errors import WbcError
from wbc.problem import Problem, load_problem
from wbc.problem.pendulum.plan import Planning
from wbc.problem.pendulum.problem import PendulumProblem
from wbc.rmp.plan import load_plan, save_plan, solve

COUNT = int(os.environ.get("WBC_FUZZ", "0"))
# What a run of any of the short problems below takes at most [s]; more is a hang.
LONGEST = 20
# Longer runs are not made.
MOST_TICKS = 100

ROBOT = """\
robot: hoap2_like
start: {posture: standing, joints: {"*_knee_pitch": 0.5}}
support: double
tasks:
  shape: {type: inertia, components: diagonal, frame: base, target: {scale: 1.1}, ramp: 0.01}
  com: {type: com, axes: [x, y], target: {offset: [0.0, 0.0, 0.0]}, weight: [2, 3]}
  hand: {type: frame, frame: left_hand, control: position, target: start}
  face: {type: frame, frame: torso, control: orientation, target: {rpy: [0, 0, 0.1]}}
  calm: {type: posture, target: start, joints: {"*_hip_*": 0}, weight: 0.1}
  spin: {type: momentum, components: angular, active: false}
constraints:
  over: {type: com_support, margin: 0.005, slack: 10}
  room: {type: box, frame: base, upper: [1, 1, null]}
limits: {margin: 0.01, acceleration: 100}
controller: {dt: 0.005, solver: proxqp, eps: 1e-6, joint_weights: {base: 10}}
stop: {duration: 0.02, speed: null, accept: {com: 1.0e-3}}
"""
PHASES = """\
robot: hoap2_like
support: double
tasks:
  com: {type: com, target: {over: double}, gain: 0.1}
  swing: {type: frame, frame: right_sole, control: position, target: start, active: false}
phases:
  shift: {duration: 0.01, tasks: {com: {target: {over: left}, weight: 2}}}
  lift:
    duration: 0.01
    support: left
    tasks: {swing: {active: true, target: {offset: [0, 0, 0.1]}}}
"""
LAW = """\
model: rmp_planar
mass: 35.0
start: {leg_length: 0.7, radii: 0.25, theta: 1.5, rates: {spin: 0.1}}
bounds: {polygon: [-0.1, 0.1], wheel_torque: 60.0, leg_force: [0, 2000], radius: [0.01, 0.5]}
law: {type: static_lean, angle: 1.5, rate: 8}
pushes: [{time: 0.01, impulse: [1, 0]}]
plant: {mass: 1.01}
stop: {duration: 0.03, dt: 0.002, accept: {leg: 0.1}}
"""
LQR = """\
model: rmp_solid
mass: 35.0
start: {leg_length: 0.7, inertia: [1, 1.1, 1.2], phi: 0.01, rpy: [0, 0, 0.1],
  rates: {spin: [0, 0, 0.1]}}
bounds: {polygon: [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1]], wheel_torque: 60.0}
law: {type: lqr, foot: true}
stop: {duration: 0.03, dt: 0.002, accept: {wheel_rate: 0.1}}
"""
PLAN = """\
model: rmp_solid
mass: 30.0
plan:
  start: {com: [0, 0, 0.75], com_velocity: [0, 0, 0], rotation: [0, 0, 0], momentum: [0, 0, 0],
          radii: [0.2, 0.2, 0.2], radii_rates: [0, 0, 0]}
  goal: {com: [0, null, 0.75], com_velocity: [0, 0, 0]}
  nominal: {inertia: [1, 1.1, 1.2]}
  schedule:
    push: {duration: [0.3, 0.5], support: {at: [0, 0], size: [0.2, 0.2]}, intervals: 2}
    fly: {duration: 0.1, support: flight, intervals: 1}
    land: {duration: 0.5, support: [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1]], intervals: 2}
  limits: {leg_length: [0.4, 0.9], normal_force: [10.0, 2000.0], friction: 0.7, radius: [0.1, 0.3]}
  weights: {com: 1, momentum: 2}
  periodic: null
  degree: 3
  iterations: 20
"""
FILES = {"robot": ROBOT, "phases": PHASES, "law": LAW, "lqr": LQR, "plan": PLAN}
LAWS = {
    "rmp_planar": [
        {"type": "static_lean", "angle": 1.5},
        {"type": "swing_up"},
        {"type": "lqr", "errors": [0.1, 0.2, 1, 0.1, 1, 2, 3, 4]},
        {"type": "spin", "spin": 0.2, "within": 0.01},
    ],
    "rmp_solid": [
        {"type": "momentum_qp", "com": [0.0, 0.0, 0.7]},
        {"type": "stabiliser"},
        {"type": "lqr", "foot": True},
        {"type": "spin", "spin": 0.2, "within": 0.01},
    ],
}
# What a value is replaced by. The texts stand as they are: YAML decides what they are.
NASTY = [
    "0", "-0.0", "-1", "1", "3", "1e9", "-1e9", "1e-9", "1e-300", "5e-324", "1e300", "1e400",
    ".inf", "-.inf", ".nan", "_", "+_", "-__", "1__0", "0x_", "0b", "0o_", "1_000", "0,01",
    "1:30", "~",
    "true", "off", "[]", "{}", "[0, 0, 0]", "[1e9, 1e9, 1e9]", "[0, 0]", "[1, 1, 1, 1]",
    "start", "[[0, 0], [0, 0], [0, 0]]", "[[0, 0], [1, 0], [1, 1], [0, 1]]", "''", "'*'", "''''",
    "2001-01-01", "base", "flight", "double", "none", "left", "{frame: base}", "'\\0'",
    "\u202e", "9" * 400, "<<",
    "{offset: [1, 2, 3]}", "{scale: 0}", "[x, x]", "[[1]]", "{0: 1}", "{'': 1}", "{com: 1}",
    "'a.b'",
]  # fmt: skip


def paths(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the place of every value below the top."""
    entries = value.items() if isinstance(value, dict) else ()
    for key, entry in enumerate(value) if isinstance(value, list) else entries:
        yield (*at, key)
        yield from paths(entry, (*at, key))


def written(value: Any) -> str:
    """Return a value in YAML's flow style; a text in a Raw stands as it is."""
    if isinstance(value, Raw):
        return value.text
    if isinstance(value, dict):
        return "{" + ", ".join(f"{written(k)}: {written(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(written(entry) for entry in value) + "]"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return repr(value)


class Raw:
    """A piece of YAML."""

    def __init__(self, text: str) -> None:
        self.text = text


def mutated(data: dict[str, Any], rng: random.Random) -> str:
    """Return the text of a problem with one to three mistakes in it."""
    data = copy.deepcopy(data)
    if "law" in data and rng.random() < 0.5:
        data["law"] = dict(rng.choice(LAWS[data["model"]]))
    for _ in range(rng.choice((1, 1, 2, 3))):
        places = list(paths(data))
        if not places:
            break
        *above, last = rng.choice(places)
        inside: Any = data
        for step in above:
            inside = inside[step]
        what = rng.random()
        number = type(inside[last]) in (float, int)
        if number and what < 0.4:
            inside[last] *= rng.choice((0, -1, 0.1, 1e-3, 1e-12, 3, 1e2, 1e5, 1e8))
        elif what < 0.7:
            inside[last] = Raw(rng.choice(NASTY))
        elif what < 0.8:
            del inside[last]
        elif what < 0.9 and isinstance(inside, dict):
            inside[str(last)[:-1] + rng.choice("xq_")] = inside.pop(last)
        else:  # what stands elsewhere
            *way, end = rng.choice(places)
            there: Any = data
            for step in way:
                there = there[step]
            inside[last] = copy.deepcopy(there[end]) if isinstance(there, dict | list) else there
    text = "\n".join(f"{written(key)}: {written(value)}" for key, value in data.items()) + "\n"
    if rng.random() < 0.1:
        k = rng.randrange(len(text))
        text = (
            text[:k]
            + rng.choice(("", "\t", ":", "-", "{", "]", "'", "&a ", "*a", "!", "\n"))
            + text[k + 1 :]
        )
    return text


def load_and_run(path: Path) -> None:
    """Load a problem, and run it unless its numbers now ask for a long run."""
    problem = load_problem(path)
    stop = getattr(problem.spec, "whole_stop", None) or problem.spec.stop
    dt = problem.spec.controller.dt if isinstance(problem, Problem) else problem.spec.stop.dt
    if stop.duration / dt <= MOST_TICKS:
        problem.run()


@contextmanager
def limited(seconds: int) -> Iterator[None]:
    """Raise TimeoutError if the block takes longer."""

    def late(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize(
    ("kind", "default"), [("robot", 20), ("phases", 15), ("law", 40), ("lqr", 20), ("plan", 12)]
)
def test_problem_files(kind: str, default: int, tmp_path: Path) -> None:
    data = YAML(typ="safe", pure=True).load(FILES[kind])
    for seed in range(COUNT or default):
        text = mutated(data, random.Random(f"{kind} {seed}"))
        path = tmp_path / "p.yaml"
        path.write_text(text, encoding="utf-8")
        check(lambda path=path: load_and_run(path), f"{kind} {seed}:\n{text}")


def check(run: Callable[[], object], what: str) -> None:
    """Fail unless ``run`` ends in time, with a result or a WbcError."""
    try:
        with limited(LONGEST):
            run()
    except WbcError:
        pass
    except TimeoutError:
        pytest.fail(f"hangs: {what}")
    except Exception as error:
        raise AssertionError(what) from error


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the file of a plan."""
    folder = tmp_path_factory.mktemp("plan")
    problem = problem_of(folder, PLAN.replace("iterations: 20", "iterations: 100"))
    assert isinstance(problem, PendulumProblem) and isinstance(problem.parts, Planning)
    return save_plan(solve(problem.parts.problem), folder / "p.npz")


def test_damaged_plan_files(plan: Path, tmp_path: Path) -> None:
    whole = plan.read_bytes()
    for seed in range(COUNT or 100):
        (tmp_path / "p.npz").write_bytes(damaged(whole, random.Random(seed)))
        check(lambda: load_plan(tmp_path / "p.npz"), f"bytes {seed}")


def test_plan_files_with_other_contents(plan: Path, tmp_path: Path) -> None:
    """Files in order, of problems and arrays that are none."""
    with np.load(plan) as file:
        arrays = {name: file[name] for name in ("solution", "duals_variables", "duals_rows")}
        meta = json.loads(str(file["meta"]))
    values: list[Any] = [
        None, True, -1, 0, 1e-300, 1e300, 10**6, 10**400, "", "x", [], {}, [1, 2, 3], [[]],
        {"a": 1},
        [0, 0], math.nan, -math.inf, "solid", [None, None, None], [[0, 0], [1, 0], [0, 1]],
    ]  # fmt: skip
    for seed in range(COUNT or 60):
        rng = random.Random(seed)
        data, others = copy.deepcopy(meta), dict(arrays)
        for _ in range(rng.choice((1, 2))):
            *above, last = rng.choice([one for one in paths(data) if one])
            inside = data
            for step in above:
                inside = inside[step]
            if rng.random() < 0.8 or not isinstance(inside, dict):
                inside[last] = copy.deepcopy(rng.choice(values))
            else:
                inside[f"{last}x"] = inside.pop(last)
        if rng.random() < 0.2:
            name = rng.choice(list(others))
            others[name] = rng.choice(
                (others[name][:-1], others[name] * np.nan, np.zeros((2, 2)), np.array("x"))
            )
        np.savez(tmp_path / "p.npz", meta=np.array(json.dumps(data)), **others)
        check(lambda: load_plan(tmp_path / "p.npz"), f"contents {seed}:\n{data}")
