"""Runs as streams and as MCAP: what the formats' own readers get is the run."""

import json
import re
import socket
import struct
import subprocess
import sys
from contextlib import closing
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
from wbc.errors import InvalidInputError, MissingPackageError, UnknownNameError, WbcError
from wbc.problem import Problem
from wbc.problem.saved import SavedRun
from wbc.view.mcap_export import mcap_format, transforms, write_mcap
from wbc.view.streams import FoxgloveStream, RerunStream, stream_of

STANDS = """
robot: hoap2_like
start: {posture: standing}
support: double
tasks:
  com: {type: com, target: {offset: [0.01, 0, 0]}, weight: 10.0}
  posture: {type: posture, target: start, weight: 0.1}
stop: {duration: 0.05}
"""
PENDULUM = Path(__file__).parents[2] / "problems" / "rmp_spin.yaml"
Topics = dict[str, list[tuple[int, dict[str, Any]]]]


@pytest.fixture
def problem(tmp_path: Path) -> Problem:
    return problem_of(tmp_path, STANDS)


def test_foxglove_is_sent_frames_and_numbers_of_every_tick(problem) -> None:
    pytest.importorskip("foxglove")
    client = pytest.importorskip("websockets.sync.client")
    stream = FoxgloveStream(problem.parts.robot, port=0)
    ticks, topics, found = [], {}, {}
    with client.connect(stream.where.split()[-1], subprotocols=["foxglove.sdk.v1"]) as server:

        def listen() -> None:
            """Subscribe to what is offered, and keep what comes."""
            while True:
                try:
                    message = server.recv(timeout=0.3)
                except TimeoutError:
                    return
                if isinstance(message, bytes):
                    _, channel, stamp = struct.unpack("<BIQ", message[:13])
                    found.setdefault(topics[channel], {})[stamp] = json.loads(message[13:])
                    continue
                offer = json.loads(message)
                if offer["op"] == "advertise":
                    numbers = [one["id"] for one in offer["channels"]]
                    topics.update({one["id"]: one["topic"] for one in offer["channels"]})
                    wanted = [{"id": one, "channelId": one} for one in numbers]
                    server.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

        def show(now, controller) -> None:
            ticks.append(now)
            stream.show(now, controller)
            if len(ticks) < 3:
                listen()

        listen()
        problem.run(show=show)
        listen()
    stream.close()
    last = ticks[-1]
    stamp = round(1e9 * last.time)
    assert len(found["/tf"]) == len(ticks)
    places = {one["child_frame_id"]: one for one in found["/tf"][stamp]["transforms"]}
    for name in ("left_sole", "right_hand"):
        place = [places[name]["translation"][axis] for axis in "xyz"]
        np.testing.assert_allclose(place, last.snapshot.position(name), atol=1e-12)
    com = [found["/com"][stamp][axis] for axis in "xyz"]
    np.testing.assert_allclose(com, last.snapshot.com, atol=1e-12)
    error = list(found["/errors/com"][stamp].values())
    np.testing.assert_allclose(error, last.tick.errors["com"], atol=1e-12)


@pytest.mark.slow
def test_rerun_reads_the_ellipsoid_where_the_robot_is(problem, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    path, ticks = tmp_path / "run.rrd", []
    stream = stream_of(problem.parts.robot, f"rerun:{path}")

    def show(now, controller) -> None:
        ticks.append(now)
        stream.show(now, controller)

    problem.run(show=show)
    stream.close()
    assert isinstance(stream, RerunStream)
    reader = [sys.executable, "-m", "rerun", "rrd", "print", "-vvv", "--entity", "/ellipsoid", path]
    told = subprocess.run(reader, capture_output=True, text=True, check=True).stdout
    number = r"-?[0-9.e-]+"
    found = re.findall(rf"P(?:0D|T)[0-9.]*S? +┆ \[\[({number}), ({number}), ({number})\]\]", told)
    assert len(found) == len(ticks)
    wanted = [now.snapshot.com for now in ticks]
    np.testing.assert_allclose(np.array(found, dtype=float), wanted, atol=1e-6)  # single precision


@pytest.mark.parametrize(
    ("wanted", "error", "says"),
    [
        ("foxgolve", UnknownNameError, "foxglove"),
        ("foxglove:https", InvalidInputError, "a port from 0 to 65535"),
        ("foxglove:70000", InvalidInputError, "a port from 0 to 65535"),
    ],
)
def test_a_stream_that_is_none_is_named(problem, wanted: str, error: type, says: str) -> None:
    with pytest.raises(error, match=says):
        stream_of(problem.parts.robot, wanted)


@pytest.mark.parametrize("wanted", ["rerun:nobody", "rerun:/nowhere/run.rrd"])
def test_rerun_that_cannot_be_reached_or_written_is_refused(problem, wanted: str) -> None:
    pytest.importorskip("rerun")
    with pytest.raises(InvalidInputError, match=f"stream '{wanted}': "):
        stream_of(problem.parts.robot, wanted)


def test_rerun_to_which_nobody_listens_is_refused_before_the_run(problem) -> None:
    """After some thousand ticks its queue was full: the run hung, and no signal ended it."""
    pytest.importorskip("rerun")
    with closing(socket.socket()) as taken:  # a port at which nobody answers
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(InvalidInputError, match="nobody listens there; start a viewer first"):
            stream_of(problem.parts.robot, f"rerun:rerun+http://127.0.0.1:{port}/proxy")


def test_a_rerun_viewer_is_named_by_its_host_and_port(problem) -> None:
    pytest.importorskip("rerun")
    with closing(socket.create_server(("127.0.0.1", 0))) as viewer:
        port = viewer.getsockname()[1]
        stream = stream_of(problem.parts.robot, f"rerun:127.0.0.1:{port}")
        assert stream.where == f"Rerun: 127.0.0.1:{port}"
    stream._is_gone = True  # nothing is to be sent
    with pytest.raises(WbcError):
        stream.close()


def test_a_rerun_viewer_that_is_closed_meanwhile_is_told_at_the_end(problem, monkeypatch) -> None:
    pytest.importorskip("rerun")
    monkeypatch.setattr("wbc.view.streams.LOOK_TIME", 0.0)
    monkeypatch.setattr("wbc.view.streams.FLUSH_TIME", 0.5)
    with closing(socket.create_server(("127.0.0.1", 0))) as viewer:
        port = viewer.getsockname()[1]
        stream = stream_of(problem.parts.robot, f"rerun:rerun+http://127.0.0.1:{port}/proxy")
    problem.run(show=stream.show)
    with pytest.raises(WbcError, match="not all was sent: the viewer was closed meanwhile"):
        stream.close()


def test_a_package_that_is_missing_is_named(problem, monkeypatch) -> None:
    monkeypatch.setattr("wbc.extras.find_spec", lambda name: None)
    for wanted in ("foxglove", "rerun"):
        with pytest.raises(MissingPackageError, match=rf"wbc\[{wanted}\]"):
            stream_of(problem.parts.robot, wanted)


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
