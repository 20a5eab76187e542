"""The JSON Schema says what the models say."""

import inspect
import os
import shutil
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

import wbc
from wbc.constraints.limits import BRAKING
from wbc.controllers.tick import POLICIES
from wbc.controllers.torque import POLICIES as TORQUE_POLICIES
from wbc.problem.controller_spec import GlobalSpec
from wbc.problem.json_schema import json_schema
from wbc.problem.spec import ProblemSpec
from wbc.problem.yaml_reader import parse, read_source
from wbc.rmp.plan import Weights
from wbc.robot.collision.bodies import FITS
from wbc.run.global_shaping import shape_globally

PROBLEMS = sorted((Path(__file__).parents[2] / "problems").glob("*.yaml"))
jsonschema = pytest.importorskip("jsonschema")
SCHEMA = json_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def fits(value: Any) -> bool:
    return VALIDATOR.is_valid(value)


def good_by_model(data: Any) -> bool:
    try:
        ProblemSpec.model_validate(data)
    except ValidationError:
        return False
    return True


BASE = "robot: g1\ntasks:\n  t: {type: com, target: start}\n"


def with_task(task: str) -> str:
    return f"robot: g1\ntasks:\n  t: {task}\n"


GOOD = [
    BASE,
    BASE + "limits: none\nsupport: [a, {frame: b, type: point}]\nversion: 1\n",
    BASE + "limits: {velocity: null, acceleration: {'*': 3}, base_twist: [1, 1, 1, 1, 1, 1]}\n",
    BASE
    + "controller: {method: pseudo_inverse, damping: 0.1}\nstop: {speed: null, accept: {t: 1}}\n",
    BASE + "controller: {method: global}\n",
    BASE + "controller: {level: torque, torque_limits: null, force_damping: 0.1, friction: 0.7}\n",
    BASE + "controller: {level: torque, friction: {facets: 8, inner: false, most: 9}}\n",
    BASE + "support: [{frame: a, kp: 1, kd: 2, friction: grip, corners: [[0, 1], [1, 0, 2]]}]\n",
    with_task("{type: com, target: start, axes: [x], law: capture_point}"),
    with_task("{type: com, target: start, law: {type: capture_point, gain: 3}}"),
    with_task("{type: com, target: start, kp: 30, kd: 2}"),
    with_task("{type: momentum, kd: 3}"),
    BASE + "controller: {method: global, starts: 9, seconds: 1.5, workers: 1, seed: 3, attempts: 2,"
    " tolerance: 0, support_margin: 0.01, solver: active_set, eps: null, dt: 0.01}\n",
    BASE.replace(
        "g1", "{model: x.urdf, locked: {a: 0}, feet: {l: {link: f}}, srdf: s, package_dirs: [.]}"
    ),
    with_task("{type: inertia, target: {scale: 2}}"),
    with_task("{type: inertia, target: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}"),
    with_task("{type: inertia, components: trace, target: 3, per_mass: true, ramp: 1}"),
    with_task("{type: inertia, components: [xx, xy], target: [1, 0, 0, 1, 0, 1], weight: [1, 2]}"),
    with_task("{type: frame, frame: f, control: position, target: {offset: [0, 0, 1]}, axes: [z]}"),
    with_task("{type: frame, frame: f, control: orientation, target: {rpy: [0, 0, 1]}}"),
    with_task("{type: frame, frame: f, control: orientation, target: {quaternion: [0, 0, 0, 1]}}"),
    with_task("{type: frame, frame: f, control: pose, target: {position: [1, 2, 3]}}"),
    with_task("{type: frame, frame: f, control: axis, axis: [1, 0, 0], target: [0, 0, 1]}"),
    with_task("{type: posture, target: standing, joints: {'*': 0.5}}"),
    with_task("{type: posture, target: {knee: 1}}"),
    with_task("{type: posture, target: start}"),
    with_task("{type: momentum, components: [kx], target: [1]}"),
    with_task("{type: contact_force, frame: f, components: [fz], target: [9], weight: [2]}"),
    with_task("{type: load_share, target: {a: 1, b: 2}, priority: 1}"),
    with_task("{type: cop, target: [0, 0.1]}"),
    with_task("{type: force_rate, frames: [a]}"),
    with_task("{type: torque, target: {'*': 1}, joints: ['*_knee']}"),
    with_task("{type: torque, target: 2}"),
]
BAD = [
    "robot: g1\n",
    BASE + "robots: 1\n",
    BASE + "version: 2\n",
    BASE + "limits: {margin: -1}\n",
    BASE + "limits: off\n",
    BASE + "support: {frame: a}\n",
    BASE + "controller: {method: pseudo_inverse, solver: active_set}\n",
    BASE + "controller: {method: global, starts: 0}\n",
    BASE + "controller: {method: global, seconds: 0}\n",
    BASE + "controller: {method: qp, starts: 9}\n",
    BASE + "controller: {starts: 9}\n",
    BASE + "controller: {level: torques}\n",
    BASE + "controller: {force_damping: 0.1}\n",
    BASE + "controller: {level: torque, starts: 9}\n",
    BASE + "controller: {level: torque, method: global}\n",
    BASE + "controller: {level: torque, on_failure: hold}\n",
    BASE + "controller: {level: torque, friction: {facets: 2}}\n",
    BASE + "support: [{frame: a, friction: glue}]\n",
    with_task("{type: com, target: start, law: capture}"),
    with_task("{type: momentum, kp: 3}"),
    BASE + "stop: {duration: 0}\n",
    with_task("{type: com}"),
    with_task("{type: com, target: [1, 2]}"),
    with_task("{type: com, target: start, gain: 0}"),
    with_task("{type: com, target: start, gain: '0.5'}"),
    with_task("{type: com, target: start, axes: xy}"),
    with_task("{type: frame, frame: f, target: start}"),
    with_task("{type: frame, frame: f, control: orientation, target: [0, 0, 1]}"),
    with_task("{type: frame, frame: f, control: axis, target: {offset: [0, 0, 1]}}"),
    with_task("{type: posture, gain: true}"),
    with_task("{type: momentum, gain: 0.5}"),
    with_task("{type: inertia, target: wide}"),
    with_task("{type: contact_force, frame: f, components: [f]}"),
    with_task("{type: load_share, target: {a: 1}}"),
    with_task("{type: cop, target: [1]}"),
    with_task("{type: force_rate, kd: 1}"),
    with_task("{type: torque, target: start}"),
]


@pytest.mark.parametrize("text", GOOD)
def test_accepted_by_both(text: str) -> None:
    data = parse(text, "p.yaml").data
    assert good_by_model(data)
    assert fits(data)
    spec = ProblemSpec.model_validate(data)
    assert ProblemSpec.model_validate(spec.model_dump()) == spec, "it survives being written"


@pytest.mark.parametrize("text", BAD)
def test_refused_by_both(text: str) -> None:
    data = parse(text, "p.yaml").data
    assert not good_by_model(data)
    assert not fits(data)


@pytest.mark.parametrize("path", PROBLEMS, ids=lambda path: path.stem)
def test_the_problems_of_this_repository_fit(path: Path) -> None:
    assert fits(read_source(path).data)


def test_it_is_a_schema() -> None:
    VALIDATOR.check_schema(SCHEMA)


def test_files_for_retargeting_are_in_it() -> None:
    good = {"motion": "walk.trc", "robot": "talos", "links": {"head": "head_2_link"}, "roll": 0.5}
    assert fits(good)
    for wrong in ({"roll": 2.0}, {"speed": 1.0}, {"unit": "feet"}, {"robot": 3}):
        assert not fits(good | wrong)


def test_every_key_is_described() -> None:
    sections = list(SCHEMA["$defs"].values())
    missing = [
        f"{section['title']}.{key}"
        for section in sections
        for key, one in section["properties"].items()
        if "description" not in one and "const" not in one  # `type: com` describes itself
    ]
    assert missing == []
    assert all(section.get("description") for section in sections)


def test_planning_weights_default_to_the_planner_s() -> None:
    keys = SCHEMA["$defs"]["Weights"]["properties"]
    assert {name: key["default"] for name, key in keys.items()} == asdict(Weights())


@pytest.mark.parametrize(
    ("section", "key", "words"),
    [
        ("QpSpec", "on_failure", POLICIES),
        ("TorqueSpec", "on_failure", TORQUE_POLICIES),
        ("LimitsSpec", "braking", BRAKING),
        ("SelfCollisionSpec", "fit", FITS),
    ],
)
def test_choices_are_those_of_the_classes(section: str, key: str, words: tuple[str, ...]) -> None:
    assert SCHEMA["$defs"][section]["properties"][key]["enum"] == list(words)


def test_the_search_s_defaults_are_those_for_python_users() -> None:
    # Not read from it, for it loads CasADi.
    given = inspect.signature(shape_globally).parameters
    spec = GlobalSpec(method="global")
    assert {key: given[key].default for key in spec.search} == spec.search


NEW_KIND = """
from typing import Literal
from wbc.problem.kinds.com import ComSpec
from wbc.problem.task_spec import ErrorTaskSpec

class HighSpec(ErrorTaskSpec):
    '''The CoM, somewhat higher.'''
    type: Literal["high"]
    target: float
    weight: float = 1.0

    def build(self, name, start):
        target = {"offset": (0.0, 0.0, self.target)}
        com = ComSpec.model_validate({"type": "com", "target": target, "gain": self.gain})
        return com.build(name, start)
"""
USE_IT = """
import sys
from wbc.problem import json_schema, load_problem
parts = load_problem(sys.argv[1]).parts
(task,) = parts.tasks
assert abs(task.target - task.robot.snapshot(parts.start).com - (0, 0, 0.01)).max() < 1e-12
assert task.gain == 0.3
assert "HighSpec" in json_schema()["$defs"]
"""


@pytest.mark.slow
def test_a_new_kind_of_task_is_its_file_and_nothing_else(tmp_path: Path) -> None:
    shutil.copytree(
        Path(wbc.__file__).parent, tmp_path / "wbc", ignore=shutil.ignore_patterns("__pycache__")
    )
    (tmp_path / "wbc/problem/kinds/high.py").write_text(NEW_KIND)
    file = tmp_path / "p.yaml"
    file.write_text(
        "robot: hoap2_like\nsupport: floating\n"
        "tasks:\n  up: {type: high, target: 0.01, gain: 0.3}\n"
    )
    run = [sys.executable, "-c", USE_IT, str(file)]
    home = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(run, check=False, capture_output=True, text=True, cwd=tmp_path, env=home)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_problems_of_robots_do_not_wait_for_casadi_nor_for_mujoco() -> None:
    # In a process of its own: other tests have loaded them here.
    command = (
        "import sys, wbc.problem, wbc.cli.outputs, wbc.simulation;"
        "sys.exit(len({'casadi', 'mujoco'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", command], check=False).returncode == 0
