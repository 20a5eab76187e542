"""A page without a process of its own, and a client without a browser."""

import multiprocessing
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import viser
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

import wbc
from tests.needs import BROWSER, SOFTWARE
from tests.problem.loading import problem_of
from tests.texts import STAND
from wbc.problem.problem import Problem
from wbc.rotations import rotation_from
from wbc.view.live.collect import controller_info, obstacles_of, targets_of, tick_info
from wbc.view.live.layers.layer import WORLD
from wbc.view.live.messages import Frame, PullForce, Restart, Setup
from wbc.view.live.page import Page
from wbc.view.live.process import HOST, page_address
from wbc.view.live.server import Server
from wbc.view.live.session import checked


def client_of(url: str, origin: str | None = None) -> ClientConnection:
    """Connect as a browser does, and say where the camera is, which makes it a client."""
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    address = url.replace("http://", "ws://").replace("localhost", HOST)
    page = None if origin is None else Origin(origin)
    client = connect(address, subprotocols=[protocol], max_size=None, origin=page)
    lens = {"fov": 1.0, "near": 0.01, "far": 100.0, "image_height": 600, "image_width": 800}
    place = {"wxyz": (1.0, 0.0, 0.0, 0.0), "position": (1.0, 0.0, 1.0)}
    aim = {"look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 0.0, 1.0)}
    tell(client, "ViewerCameraMessage", **lens, **place, **aim)
    return client


def tell(client: ClientConnection, kind: str, **fields: object) -> None:
    """Send a message, as the page's JavaScript does."""
    client.send(msgspec.msgpack.encode({"type": kind, **fields}))


def drag(
    client: ClientConnection, name: str, position: Any, wxyz: Any = (1.0, 0.0, 0.0, 0.0)
) -> None:
    """Drag the handle of a target somewhere."""
    place = {"position": position, "wxyz": wxyz}
    place = {key: np.asarray(value, dtype=float).tolist() for key, value in place.items()}
    handle = f"{WORLD}/drag_targets/{name}"
    tell(client, "TransformControlsUpdateMessage", name=handle, **place, owner="")


class Stage:
    """A page in this process, and the pipe that leads to it; options as of :class:`Setup`."""

    def __init__(self, robot: wbc.Robot, **options: Any) -> None:
        self.pipe, theirs = multiprocessing.Pipe()
        place = page_address(HOST, None)
        self.server = Server(place.host, place.port, "test", robot.name)
        setup = Setup(robot, "test", clock=True, steer=True, **options)
        self.page = Page(setup, self.server, theirs)

    @property
    def url(self) -> str:
        return f"http://{HOST}:{self.server.get_port()}"

    def handle(self, name: str) -> Any:
        found = self.server.scene.get_handle_by_name(WORLD + name)
        assert found is not None, name
        return found

    def gui(self, label: str, nth: int = 0) -> Any:
        """Return the nth GUI element of that label."""
        every = self.server.gui._gui_input_handle_from_uuid.values()
        return [one for one in every if getattr(one, "label", None) == label][nth]

    def move_slider(self, client: ClientConnection, label: str, value: float, nth: int = 0) -> None:
        uuid = self.gui(label, nth)._impl.uuid
        tell(client, "GuiUpdateMessage", uuid=uuid, updates={"value": value})

    def draw(self, *messages: object) -> None:
        for message in messages:
            self.page.receive(message)  # type: ignore[arg-type]
        self.page._panel_at = self.page._controls_at = 0.0
        self.page.draw()

    def show(self, controller: wbc.Controller, q: Any = None, time: float = 0.0) -> wbc.Snapshot:
        """Draw a controller and its tick, by default standing; return the state."""
        q = controller.robot.posture("standing") if q is None else q
        self.draw(controller_info(controller), frame_at(controller, q, time))
        return controller.robot.snapshot(q)

    def check_placed(self, layer: str, snapshot: wbc.Snapshot) -> None:
        """Fail unless the nodes of a layer are where a robot's joints are."""
        rotations, origins = snapshot.joint_placements
        joints = list(self.server.scene._children_from_node_name[f"{WORLD}/{layer}"])
        assert len(joints) > 10
        for joint in joints:
            node, k = self.handle(joint.removeprefix(WORLD)), int(joint.rsplit("/", 1)[1])
            np.testing.assert_allclose(node.position, origins[k], atol=1e-9)
            np.testing.assert_allclose(rotation_of(node), rotations[k], atol=1e-9)


def balanced(robot: wbc.Robot, mode: str = "double", q: Any = None) -> wbc.KinematicController:
    """Return what keeps the CoM of a robot that stands, on some of its feet."""
    start = robot.snapshot(robot.posture("standing") if q is None else q)
    contacts = wbc.support(start, mode)
    return wbc.KinematicController(robot, [wbc.ComTask(robot, start.com)], contacts=contacts)


def rotation_of(handle: Any) -> np.ndarray:
    """Return the rotation (3, 3) of a node."""
    return rotation_from(np.roll(handle.wxyz, -1))


def simulated_problem(folder: Path, simulation: str) -> Problem:
    """Return a small humanoid that stands in simulation; ``simulation`` as in a problem file."""
    return checked(problem_of(folder, STAND + f"simulation: {simulation}\n"))


class Watched:
    """A viewer without a page, which asks for something after a tick."""

    closed, controller = False, None
    has_wishes = False

    def __init__(self) -> None:
        self.seen: list[tuple[np.ndarray, np.ndarray, str]] = []
        self.pulls: list[PullForce | None] = []
        self.asks: dict[int, object] = {}

    def update(  # type: ignore[no-untyped-def]
        self, snapshot, *_, push, pull, remark, **__
    ) -> None:
        self.seen.append((snapshot.q, push.copy(), remark))
        self.pulls.append(pull)

    def steer(self) -> None: ...

    def next_request(self) -> object:
        return self.asks.pop(len(self.seen), None)

    def wait_for_user(self, *_: float) -> None:
        self.asks.setdefault(len(self.seen), Restart())


def frame_at(controller: wbc.Controller, q: np.ndarray, time: float) -> Frame:
    """Return what the page is told of a controller's tick."""
    snapshot = controller.robot.snapshot(q)
    tick = controller.step(snapshot)
    targets, obstacles = targets_of(controller), obstacles_of(controller)
    return Frame(time, q, snapshot.v, tick_info(tick), targets, obstacles)


@pytest.fixture(scope="session")
def robot() -> wbc.Robot:
    return wbc.Robot.load("hoap2_like")


@pytest.fixture
def stages(robot: wbc.Robot) -> Iterator[Callable[..., Stage]]:
    """Return what makes pages, which end with the test."""
    with ExitStack() as opened:

        def make(**options: Any) -> Stage:
            made = Stage(robot, **options)
            opened.callback(made.server.stop)
            return made

        yield make


@pytest.fixture
def stage(stages: Callable[..., Stage]) -> Stage:
    return stages()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=BROWSER, args=list(SOFTWARE))
        yield opened
        opened.close()
