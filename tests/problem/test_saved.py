"""A result read back is the run that was saved, and identical runs give identical bits."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from tests.texts import REACH
from wbc.errors import InvalidInputError, ModelError, ProblemFileError
from wbc.problem import load_problem
from wbc.problem.replay import replay_run
from wbc.problem.saved import load_result
from wbc.robot import Robot
from wbc.run import Result

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
SCRIPT = """
import hashlib, sys
from dataclasses import replace
import numpy as np
from wbc.problem import load_problem

rng, kept = np.random.default_rng(int(sys.argv[2])), []
for name, duration in (("astronaut_expand", 0.3), ("fig6b_g1", 0.15), ("safe_reach_g1", 0.1)):
    problem = load_problem(f"{sys.argv[1]}/{name}.yaml", {"stop.duration": duration})
    spec = problem.spec
    for solver in ("proxqp", "proxqp", "daqp", "daqp"):
        kept += [np.empty(2 * size + 200) for size in rng.integers(0, 99, size=7)]
        controller = spec.controller.model_copy(update={"solver": solver})
        chosen = replace(problem, spec=spec.model_copy(update={"controller": controller}))
        ticks = []
        history = chosen.run(observe=ticks.append).history
        bits = hashlib.sha256(history.q.tobytes() + history.v.tobytes())
        for tick in ticks:
            for part in (tick.qp.P, tick.qp.g, tick.solution.y, tick.solution.z_box):
                bits.update(part.tobytes())
        kept.append(ticks)
        print(name, solver, len(history), bits.hexdigest())
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return problem_of(tmp_path_factory.mktemp("reach"), REACH, {"stop.duration": 0.1}).run()


def test_everything_comes_back(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "r.npz")
    saved = load_result(tmp_path / "r.npz")
    assert (saved.name, saved.robot.name) == ("r", "hoap2_like")
    before, after = result.history.arrays(), saved.history.arrays()
    assert list(before) == list(after)
    for name, array in before.items():
        np.testing.assert_array_equal(after[name], array)
    assert saved.summary["problem"]["text"] == REACH


def test_the_robot_is_the_problem_s_with_its_overrides(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(REACH)
    locked = {"model": "hoap2_like", "locked": {"head_yaw": 0.1}}
    result = load_problem(path, {"robot": locked, "stop.duration": 0.01}).run()
    result.save(tmp_path / "r.npz")
    assert "head_yaw" not in load_result(tmp_path / "r.npz").robot.joint_names
    with pytest.raises(InvalidInputError, match="its joints are not those of hoap2_like"):
        load_result(tmp_path / "r.npz", Robot.load("hoap2_like"))


def test_what_is_no_result_is_refused_by_name(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "r.npz"
    np.savez(path, time=np.zeros(3))
    with pytest.raises(InvalidInputError, match="not the result of a run; make it by: wbc run"):
        load_result(path)
    np.savez(path, summary=np.array('{"format": "wbc rmp series 1"}'))
    with pytest.raises(InvalidInputError, match="is a 'wbc rmp series 1', not a"):
        load_result(path)
    np.savez(path, summary=np.array('{"format": "wbc retargeted motion 1"}'))
    with pytest.raises(InvalidInputError, match="to see it: wbc analyze MOTION"):
        load_result(path)
    summary = result.summary()
    summary["held_back"] = {"knee": {"ticks": 0, "seconds": None, "first": 0.0, "last": 0.1}}
    np.savez(path, summary=np.array(json.dumps(summary)))
    with pytest.raises(InvalidInputError, match=r"(?s)held_back.knee.ticks.*held_back.knee.sec"):
        load_result(path)
    path.write_text("text")
    with pytest.raises(InvalidInputError, match="cannot be read"):
        load_result(path)
    result.save(path)
    with np.load(path) as archive:
        kept = {name: archive[name] for name in archive.files if name != "q"}
    np.savez(path, **kept)
    with pytest.raises(InvalidInputError, match="lacks the array 'q'"):
        load_result(path)


def test_a_robot_whose_joints_have_no_range_comes_back(tmp_path: Path) -> None:
    """Reports, films and exports of an OP3's, an ANYmal's runs were refused as damaged."""
    model = Path(__file__).parents[1] / "models" / "mixed_joints.urdf"
    text = re.sub(r'(lower|upper)="[^"]*"', "", model.read_text())
    text = text.replace('type="revolute"', 'type="continuous"').replace("prismatic", "fixed")
    (tmp_path / "endless.urdf").write_text(text)
    problem_of(
        tmp_path,
        "robot: endless.urdf\nsupport: floating\ntasks: {calm: {type: posture}}\n"
        "stop: {duration: 0.01}\n",
    ).run().save(tmp_path / "r.npz")
    assert np.isposinf(load_result(tmp_path / "r.npz").history.margin).all()
    with np.load(tmp_path / "r.npz") as archive:
        wrong = {**archive, "margin": np.full(2, -np.inf)}
    np.savez(tmp_path / "r.npz", **wrong)
    with pytest.raises(InvalidInputError, match="'margin': has numbers beyond"):
        load_result(tmp_path / "r.npz")


def test_a_robot_whose_file_is_gone_can_be_given(tmp_path: Path) -> None:
    model = Path(__file__).parents[1] / "models" / "mixed_joints.urdf"
    shutil.copy(model, tmp_path / "gone.urdf")
    problem_of(
        tmp_path,
        "robot: gone.urdf\nsupport: floating\ntasks: {calm: {type: posture}}\n"
        "stop: {duration: 0.01}\n",
    ).run().save(tmp_path / "r.npz")
    assert load_result(tmp_path / "r.npz").robot.path == tmp_path / "gone.urdf"
    (tmp_path / "gone.urdf").unlink()
    with pytest.raises(ModelError, match=r"gone\.urdf"):
        load_result(tmp_path / "r.npz")
    assert load_result(tmp_path / "r.npz", Robot.load(model)).history.time.size == 2


def runs(seed: int, **environment: str) -> list[str]:
    """Return one line for each run of a fresh process, after allocations chosen by ``seed``."""
    command = [sys.executable, "-c", SCRIPT, str(PROBLEMS), str(seed)]
    surroundings = {**os.environ, **environment}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=surroundings)
    return done.stdout.splitlines()


@pytest.mark.slow
def test_identical_runs_have_identical_bits() -> None:
    first = runs(0, PYTHONHASHSEED="1")
    second = runs(1, PYTHONHASHSEED="2", PYTHONMALLOC="malloc")
    assert len(first) == 12
    assert len({line.rpartition(" ")[0] for line in first}) == 6  # three problems, two solvers
    assert first[::2] == first[1::2]  # each problem and solver twice in a process
    assert first == second


def test_where_the_files_of_a_run_elsewhere_are_is_said(tmp_path, monkeypatch) -> None:
    """The robot's file was just not there, without a word on the result or on where to go."""
    there, here = tmp_path / "there", tmp_path / "here"
    there.mkdir(), here.mkdir()
    shutil.copy(Robot.load("hoap2_like").path, there / "mine.urdf")
    (there / "p.yaml").write_text(REACH.replace("hoap2_like", "mine.urdf"))
    monkeypatch.chdir(there)
    load_problem("p.yaml", {"stop.duration": 0.01}).run().save("r.npz")
    monkeypatch.chdir(here)
    for read, error in ((load_result, ModelError), (replay_run, ProblemFileError)):
        with pytest.raises(error, match=r"there/r.npz: .*mine.urdf.* ran in a folder with p.yaml"):
            read(Path("../there/r.npz"))
