"""The viewer: a page in a process of its own, which the loop does not wait for and outlives."""

import os
import signal
import socket
import sys
import threading
import urllib.request
from collections.abc import Iterator

import numpy as np
import pytest

import wbc
from tests.urdf import stone
from tests.view.live.conftest import client_of
from wbc.errors import InvalidInputError, WbcError
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.view.live import process
from wbc.view.live.messages import Frame, Restart, Setup
from wbc.view.live.process import HOST, PageAddress, page_address
from wbc.view.live.run_viewer import RunViewer
from wbc.view.live.viewer import Viewer


@pytest.fixture(scope="module")
def viewer(robot: wbc.Robot) -> Iterator[Viewer]:
    with Viewer(robot, quiet=True) as made:
        yield made


def test_the_page_is_served_on_this_machine_only(viewer: Viewer, robot: wbc.Robot) -> None:
    viewer.show(robot.posture("standing"))
    with urllib.request.urlopen(viewer.url, timeout=20.0) as answer:
        assert b"<html" in answer.read().lower()
    port = int(viewer.url.rsplit(":", 1)[1])
    with socket.socket() as other, pytest.raises(OSError, match="refused"):
        other.connect(("127.0.0.2", port))  # another address of the same machine
    assert not viewer.error


@pytest.mark.slow
def test_the_page_is_told_of_the_terrain(robot: wbc.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a viewer, and by what shows a run while it is simulated."""
    told: list[Setup] = []
    start = process.PageProcess.__init__

    def remembered(page: process.PageProcess, place: PageAddress, setup: Setup) -> None:
        told.append(setup)
        start(page, place, setup)

    monkeypatch.setattr(process.PageProcess, "__init__", remembered)
    terrain = Terrain(slope=(0.1, 0.0))
    Viewer(robot, quiet=True).close()
    RunViewer(robot, terrain=terrain).viewer.close()  # by a viewer, which it gives its own to
    assert [one.terrain for one in told] == [LEVEL, terrain]


def test_the_page_is_sent_updates_in_order_and_the_last_one(viewer, robot, monkeypatch) -> None:
    snapshot, sent = robot.snapshot(robot.posture("standing")), list[float]()
    ends = {-1.0: threading.Event(), 19_999.0: threading.Event()}

    def send(message: object) -> None:
        if isinstance(message, Frame):
            sent.append(message.time)
            if message.time in ends:
                ends[message.time].set()

    monkeypatch.setattr(viewer._page, "send", send)
    viewer.update(snapshot, time=-1.0)
    assert ends[-1.0].wait(10.0)  # nothing of other tests waits any more
    sent.clear()
    dropped = viewer.dropped
    for k in range(20_000):  # never waits for the page
        viewer.update(snapshot, time=float(k))
    assert ends[19_999.0].wait(10.0)
    assert sent == sorted(set(sent))
    assert viewer.dropped - dropped == 20_000 - len(sent)
    viewer.update(snapshot, time=20_000.0)
    shown = sum(one < 20_000.0 for one in sent)  # the last one may be sent
    assert viewer.dropped - dropped == 20_000 - shown


def test_what_is_no_state_of_the_robot_is_refused_in_the_loop(viewer, robot) -> None:
    snapshot = robot.snapshot(robot.posture("standing"))
    other = wbc.Robot.load(stone())
    for wrong, said in (
        ((other.snapshot(other.posture("neutral")),), "of another robot, 'stone'"),
        ((snapshot.q,), "expected a snapshot"),
        ((snapshot, snapshot), "tick: expected a Tick"),
        ((snapshot, None, "1 s"), "time: "),
        ((snapshot, None, np.nan), "time: must be finite"),
    ):
        with pytest.raises(InvalidInputError, match=said):
            viewer.update(*wrong)
    with pytest.raises(InvalidInputError, match="phase: expected a name, got 5"):
        viewer.update(snapshot, phase=5)  # type: ignore[arg-type]
    assert not viewer.closed


@pytest.mark.slow
def test_the_loop_outlives_the_page(robot: wbc.Robot) -> None:
    viewer = Viewer(robot, quiet=True)
    snapshot = robot.snapshot(robot.posture("standing"))
    viewer.update(snapshot)
    os.kill(viewer._page._process.pid, signal.SIGKILL)
    assert viewer._closed.wait(20.0)
    for _ in range(3):
        viewer.update(snapshot)
    assert "the page has ended" in viewer.error
    viewer.close()


@pytest.mark.slow
def test_the_page_ends_with_the_viewer(robot: wbc.Robot) -> None:
    viewer = Viewer(robot, quiet=True)
    viewer.close()
    assert viewer._page._process.returncode is not None
    assert not viewer.error
    assert viewer.closed


def test_a_port_in_use(robot: wbc.Robot) -> None:
    with socket.socket() as other:
        other.bind((HOST, 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(InvalidInputError, match=rf"{port}: Address already in use; choose"):
            Viewer(robot, port=port)
    with pytest.raises(InvalidInputError, match="from 1 to 65535"):
        page_address(HOST, 70_000)
    with pytest.raises(InvalidInputError, match=r"no.such.host:8080"):
        page_address("no.such.host", 8080)


def test_without_a_port_the_next_free_one_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as other:
        other.bind((HOST, 0))
        other.listen()
        port = other.getsockname()[1]
        monkeypatch.setattr(process, "PORT", port)
        assert port < page_address(HOST, None).port < port + process.PORTS_TRIED


@pytest.mark.parametrize("program", ["raise SystemExit(1)", "import sys; sys.stdin.read()"])
def test_a_page_that_ends_before_it_answers_is_told(robot, monkeypatch, program: str) -> None:
    monkeypatch.setattr(process, "_PROGRAM", program)
    with pytest.raises(WbcError, match="the page did not start: its process has ended"):
        Viewer(robot, quiet=True)


def test_what_cannot_be_shown(robot: wbc.Robot, viewer: Viewer) -> None:
    with pytest.raises(InvalidInputError, match="expected a robot"):
        Viewer("g1")  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="q: NaN"):
        viewer.show(np.full(robot.nq, np.nan))
    other = wbc.Robot.load("hoap2_like")
    task = wbc.ComTask(other, [0.0, 0.0, 0.3])
    with pytest.raises(InvalidInputError, match="another robot"):
        Viewer(robot, wbc.KinematicController(other, [task]))


def test_without_viser_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(WbcError, match=r"pip install 'wbc\[view\]'"):
        _ = wbc.view.Viewer


@pytest.mark.slow
def test_the_first_who_looks_sees_the_run_from_its_beginning(robot: wbc.Robot) -> None:
    with Viewer(robot, clock=True, quiet=True) as viewer:
        viewer.show(robot.posture("standing"))
        assert viewer.next_request() is None
        for asked in (Restart(), None):  # a second page, or a reload, disturbs nobody
            with client_of(viewer.url) as client:
                client.recv(timeout=20.0)
                if asked is not None:
                    viewer.wait_for_user(20.0)
                assert viewer.next_request() == asked
