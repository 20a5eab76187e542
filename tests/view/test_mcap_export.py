"""Runs as MCAP: read by the format's own reader, they are the run."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wbc
from tests.command import wbc_command
from tests.problem.loading import problem_of
from tests.texts import REACH, STAND
from tests.urdf import geared_arm
from wbc.errors import InvalidInputError, MissingPackageError
from wbc.problem import Problem
from wbc.problem.saved import SavedRun
from wbc.view.mcap_export import mcap_format, transforms, write_mcap

PENDULUM = Path(__file__).parents[2] / "problems" / "rmp_spin.yaml"


Topics = dict[str, list[tuple[int, dict[str, Any]]]]


def exported(saved: SavedRun, path: Path) -> tuple[Topics, dict[str, Any]]:
    """Return messages with their times [ns] by topic, and what is attached, by name."""
    reader = pytest.importorskip("mcap.reader")
    write_mcap(saved.robot, saved.history, saved.summary, path, simulation=saved.simulation)
    found: Topics = {}
    with path.open("rb") as file:
        whole = reader.make_reader(file, validate_crcs=True)
        for _, channel, message in whole.iter_messages():
            found.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
        attached = {one.name: one.data for one in whole.iter_attachments()}
        attached |= {one.name: one.metadata for one in whole.iter_metadata()}
    return found, attached


def test_a_run_comes_back(tmp_path: Path) -> None:
    result = problem_of(tmp_path, REACH, {"stop.duration": 0.05}).run()
    saved = SavedRun.of(result, "p")  # type: ignore[arg-type]
    topics, attached = exported(saved, tmp_path / "a.mcap")
    history, robot = saved.history, saved.robot
    for messages in topics.values():
        np.testing.assert_allclose([t * 1e-9 for t, _ in messages], history.time, atol=1e-9)
    last = robot.snapshot(history.q[-1])
    transforms = {one["child_frame_id"]: one for one in topics["/tf"][-1][1]["transforms"]}
    for link in ("pelvis", "left_hand_link", "right_foot"):
        one = transforms[link]
        place = [one["translation"][axis] for axis in "xyz"]
        turn = Rotation.from_quat([one["rotation"][axis] for axis in "xyzw"]).as_matrix()
        np.testing.assert_allclose(place, last.position(link), atol=1e-12)
        np.testing.assert_allclose(turn, last.rotation(link), atol=1e-12)
    joints = topics["/joints/position"][-1][1]
    positions = robot.limits.joint_positions(history.q[-1])
    np.testing.assert_array_equal([joints[name] for name in robot.joint_names], positions)
    errors = topics["/errors/hand"][-1][1]
    np.testing.assert_array_equal(list(errors.values()), history.errors["hand"][-1])
    assert list(errors) == ["x", "y", "z"]
    assert attached["problem.yaml"].decode() == REACH
    assert json.loads(attached["wbc"]["status"]) == result.status.value


def test_a_simulation_has_torques_and_forces(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, STAND + "simulation: {duration: 0.02}\n")
    assert isinstance(problem, Problem)
    result = problem.simulate()
    topics, _ = exported(SavedRun.of(result, "s"), tmp_path / "a.mcap")
    forces = topics["/forces/left_sole"]
    assert len(forces) == 11
    for topic, name in ((forces, "forces/left_sole"), (topics["/joints/torque"], "torque")):
        np.testing.assert_array_equal(list(topic[-1][1].values()), result.arrays[name][-1])
    # The first row is the start, in which nothing had been measured yet.
    assert all(value is not None for value in topics["/cop"][-1][1].values())


def test_no_frame_is_its_own_parent() -> None:
    """Arms are bolted to a link that is called as the world is: a cycle to viewers."""
    robot = wbc.Robot.load(geared_arm())
    sent = transforms(robot.snapshot(robot.postures["neutral"]), 0)["transforms"]
    assert "link_d" in {one["child_frame_id"] for one in sent}
    assert all(one["child_frame_id"] != one["parent_frame_id"] for one in sent)


def test_what_cannot_be_exported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match=r"exported as \.mcap"):
        mcap_format("a.rrd")
    monkeypatch.setattr("wbc.extras.find_spec", lambda name: None)
    with pytest.raises(MissingPackageError, match=r"pip install 'wbc\[mcap\]'"):
        mcap_format("a.mcap")
    monkeypatch.setattr("wbc.extras.find_spec", lambda name: object())
    answer = wbc_command("export", PENDULUM, "-o", tmp_path / "a.mcap")
    assert answer.exit_code == 1
    assert "a pendulum, which has no links" in answer.stderr
