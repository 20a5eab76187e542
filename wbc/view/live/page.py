"""The page: receives frames, draws the selected one, and sends the user's requests.

One thread draws. The user's actions are handled by viser's threads, which only record or send them.
"""

from __future__ import annotations

import os
import pickle
import threading
import time
import traceback
from multiprocessing.connection import Connection

import numpy as np

from wbc.view.camera import viewing_axes
from wbc.view.live.camera_following import Following
from wbc.view.live.controls import Controls, PushControls, Recording
from wbc.view.live.layers.forces import ForcesLayer
from wbc.view.live.layers.ground import ComLayer, GroundLayer, SupportLayer
from wbc.view.live.layers.layer import WORLD, Context, Layer
from wbc.view.live.layers.margins import MarginsLayer, ObstaclesLayer
from wbc.view.live.layers.pendulum import EllipsoidLayer, LegLayer, MassesLayer, MomentumLayer
from wbc.view.live.layers.pushes import Grip, PullLayer, PushLayer
from wbc.view.live.layers.robot import BesideLayer, RobotLayer, RobotShapes
from wbc.view.live.layers.targets import HandlesLayer, TargetsLayer
from wbc.view.live.messages import ControllerInfo, Frame, Request, Restart, Setup, WholeRun
from wbc.view.live.panel import LivePanel
from wbc.view.live.process import Failed, Ready
from wbc.view.live.server import Server
from wbc.view.live.shown_frame import ShownFrame
from wbc.view.live.sliders import Sliders

NICE = 10  # lower priority than the control loop
SHARE = 0.2  # of a processor: limit on drawing; slow drawing means fewer frames
PERIOD = 1.0 / 40.0  # s between checks for messages
PANEL_PERIOD = 0.15  # s between updates of the numbers: faster ones cannot be read
LAYERS: tuple[type[Layer], ...] = (  # of every robot, in the order of the page
    *(GroundLayer, SupportLayer, ComLayer, LegLayer),
    *(EllipsoidLayer, MassesLayer, MomentumLayer, ForcesLayer),
)
ROBOT_OPACITY = 0.55  # opacity of the robot once there are contact forces to see
AZIMUTH, ELEVATION, DISTANCE = np.deg2rad(33.0), np.deg2rad(14.0), 1.3  # in sizes of the robot


class Page:
    """The scene, the panel, and what is shown in them."""

    def __init__(self, setup: Setup, server: Server, pipe: Connection) -> None:
        self.server = server
        self._pipe, self._sending = pipe, threading.Lock()
        self._robot, self._terrain = setup.robot, setup.terrain
        self._recording = Recording()
        self._cast: ControllerInfo | None = None
        self._drawn: tuple[Frame, ControllerInfo | None] | None = None
        self._drawn_cast: ControllerInfo | None = None
        self._changed = self._seen_forces = False
        self._last: ShownFrame | None = None
        self._panel_at = self._controls_at = 0.0
        self._awaited = setup.clock
        shapes = RobotShapes(self._robot)
        q = self._robot.posture()
        low, high = shapes.extent(self._robot, q)
        size = float(np.max(high - low))
        self._set_camera(0.5 * (low + high), size)
        self._build_gui(setup, shapes, size)

    def _set_camera(self, centre: np.ndarray, size: float) -> None:
        forward = viewing_axes(AZIMUTH, ELEVATION)[2]
        camera = self.server.initial_camera
        camera.look_at = centre
        camera.position = centre - DISTANCE * size * forward
        camera.near, camera.far = 0.02 * size, 60.0 * size

    def _build_gui(self, setup: Setup, shapes: RobotShapes, size: float) -> None:
        scene, gui = self.server.scene, self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 114, 178))
        self._world = scene.add_frame(WORLD, show_axes=False)
        context = Context(scene, size, self._robot, self._terrain)
        robot = RobotLayer(context, shapes)
        self._layers: list[Layer] = [robot, *(kind(context) for kind in LAYERS)]
        self._margins = MarginsLayer(context)
        self._layers += [self._margins, ObstaclesLayer(context), TargetsLayer(context)]
        if setup.beside is not None:
            other = context._replace(robot=setup.beside)
            self._layers.append(BesideLayer(other, RobotShapes(setup.beside)))
        if setup.steer:
            self._layers.append(HandlesLayer(context, self.send))
        tabs = gui.add_tab_group()
        self._grip: Grip | None = None
        with tabs.add_tab("Run"):
            self._controls = Controls(gui, self.send, setup.clock)
            self._following = Following(gui, size, self._terrain, self._draw_again)
            if setup.push:
                pushes = PushControls(gui, self.send, setup.push)
                push = PushLayer(context, lambda: pushes.impulse, setup.push)
                self._layers += [push, PullLayer(context)]
                self._grip = Grip(size, self._robot, robot.links, self.send)
            self._panel = LivePanel(gui, shapes.note)
        self._sliders: Sliders | None = None
        if setup.steer:
            self._sliders = Sliders(gui, tabs.add_tab("Steer"), self.send, size)
        with tabs.add_tab("Layers"):
            self._opacity = gui.add_slider("Robot opacity", 0.1, 1.0, 0.05, 1.0)
            self._opacity.on_update(lambda event: robot.set_opacity(event.target.value))
            for layer in self._layers:
                self._add_checkbox(layer)

    def _add_checkbox(self, layer: Layer) -> None:
        box = self.server.gui.add_checkbox(layer.label, True)

        def toggle(_: object) -> None:
            layer.root.visible = box.value
            self._draw_again()

        box.on_update(toggle)

    def _draw_again(self) -> None:
        self._changed = True

    def send(self, request: Request) -> None:
        """Send on what the user wants."""
        with self._sending:
            self._pipe.send(request)

    # ------------------------------------------------------------------ the one that draws

    def run(self) -> None:
        """Receive until the pipe closes, and draw while a browser is connected."""
        while True:
            if self._pipe.poll(PERIOD):
                while self._pipe.poll():
                    self.receive(self._pipe.recv())
            if self.server.get_clients():
                if self._awaited:  # the first one sees all from the start: the run may be over
                    self._awaited = False
                    self.send(Restart())
                began = time.thread_time()
                self.draw()
                # Sleep in proportion, to leave the processor to the control loop.
                time.sleep((1.0 / SHARE - 1.0) * (time.thread_time() - began))

    def receive(self, message: Frame | ControllerInfo | WholeRun) -> None:
        """Process a message."""
        if isinstance(message, ControllerInfo):
            self._cast = message
        elif isinstance(message, WholeRun):
            self._recording.replace(message.frames)
            self._controls.replay()
        else:
            self._recording.add(message, self._cast)

    def draw(self) -> None:
        """Draw the selected frame, if it is not yet drawn."""
        now, latest = time.monotonic(), self._recording.latest
        if latest is None:
            return
        if now - self._controls_at > PERIOD:
            elapsed, self._controls_at = min(now - self._controls_at, 0.2), now
            self._controls.show(self._recording, elapsed)
        past = self._controls.past
        wanted = latest if past is None else self._recording.at(past)
        if wanted is None or (wanted is self._drawn and not self._changed):
            self._write_panel(now)
            return
        self._drawn, self._changed = wanted, False
        frame, cast = wanted
        previous = None if self._last is None else self._last.state
        shown = ShownFrame(self._robot, frame, cast, previous, self._terrain)
        self._following.follow(shown.snapshot.com, frame.time)
        shown.followed = self._following.point
        with self.server.atomic():
            self._world.position = -shown.followed
            if cast is not None and cast is not self._drawn_cast:
                self._drawn_cast = cast
                for layer in self._layers:
                    layer.cast(cast)
                if self._sliders is not None:
                    self._sliders.cast(cast, shown)
            for layer in self._layers:
                if layer.root.visible:
                    layer.show(shown)
        if self._grip is not None:
            self._grip.show(shown)
        self._last = shown
        if shown.forces and not self._seen_forces:  # they act inside the legs
            self._seen_forces, self._opacity.value = True, ROBOT_OPACITY
        self._write_panel(now)

    def _write_panel(self, now: float) -> None:
        if self._last is not None and now - self._panel_at > PANEL_PERIOD:
            self._panel_at = now
            nearest = self._margins.nearest if self._margins.root.visible else ()
            self._panel.show(self._last, nearest)
            if self._sliders is not None:
                self._sliders.show(self._last)


def main(descriptor: int) -> None:
    """Serve the page until the pipe closes; run in a process of its own."""
    os.nice(NICE)
    with Connection(descriptor) as pipe:
        place, setup = pickle.loads(pipe.recv_bytes()), pickle.loads(pipe.recv_bytes())
        try:
            server = Server(place.host, place.port, setup.title, setup.robot.name)
            port = server.get_port()
            if place.exact and port != place.port:
                pipe.send(Failed(f"port {place.port} was taken in the meantime"))
                return
            pipe.send(Ready(port))
            Page(setup, server, pipe).run()
        except (EOFError, OSError):
            return  # the parent process has ended
        except BaseException as error:
            traceback.print_exc()
            pipe.send(Failed(f"{type(error).__name__}: {error}"))
            raise
