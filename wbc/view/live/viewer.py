"""The viewer's interface: shows a robot, and the ticks of its controller, in a browser."""

from __future__ import annotations

import atexit
import math
import pickle
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from numpy.typing import ArrayLike

from wbc.controllers import Controller, Tick
from wbc.controllers.checks import check_parts
from wbc.extras import require
from wbc.kinds import check_kind, check_word
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_robot, check_sizes
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.validate import Array, finite_number
from wbc.view.live.collect import controller_info, obstacles_of, targets_of, tick_info
from wbc.view.live.messages import Frame, PullForce, Request, Setup, TaskRequest, WholeRun
from wbc.view.live.process import HOST, Failed, PageProcess, page_address
from wbc.view.live.target_controls import TargetControls

PERIOD = 1.0 / 25.0  # s between frames
CLOSING = 2.0  # s to wait for the threads


class Update(NamedTuple):
    """The loop's latest data for the sender thread: references only."""

    frame: Frame  # without what the sender reads from the rest
    tick: Tick | None
    controller: Controller | None
    seconds: float | None


class Viewer:
    """Shows a robot in a web browser while a program moves it.

        viewer = wbc.view.Viewer(robot)       # prints the address
        viewer.show(q)                        # a configuration
        viewer.update(snapshot, tick)         # in a control loop, once per tick

    The page is served by a process of its own. :meth:`update` stores one reference and never waits;
    the latest is sent about 25 times a second, and others are dropped. The page may be closed,
    reloaded or opened twice: the loop does not notice.

    Parameters
    ----------
    controller:
        The controller whose targets and weights the page may change; :meth:`update` applies the
        changes, so they come between ticks. Without one the page shows and changes nothing.
    host, port:
        Address of the page. Only this machine can open it unless another host is given; anyone who
        opens it can control the robot. By default the first free port from 8080 on.
    title:
        Of the page.
    steer:
        False: the page shows the controller and changes nothing.
    clock:
        Whether the page has buttons to pause, step and restart; :meth:`next_request` returns their
        requests.
    push:
        The largest push that the page offers [N s], besides pulls by dragging the robot.
        :meth:`next_request` returns the requests, and the caller applies them. 0: neither.
    terrain:
        The terrain; by default level ground at z = 0.
    beside:
        A second robot to show, at its poses in the frames of :meth:`replay`.
    quiet:
        Do not print the address.

    Attributes
    ----------
    url:
        Address of the page.
    error:
        Why the page has ended, if it has; the loop continues.

    Raises
    ------
    MissingPackageError
        viser is not installed.
    InvalidInputError
        No robot, a controller of another robot, or a port that is in use.
    """

    def __init__(
        self,
        robot: Robot,
        controller: Controller | None = None,
        *,
        host: str = HOST,
        port: int | None = None,
        title: str | None = None,
        steer: bool = True,
        clock: bool = False,
        push: float = 0.0,
        terrain: Terrain = LEVEL,
        beside: Robot | None = None,
        quiet: bool = False,
    ) -> None:
        require("viser", "the live viewer")
        check_robot("Viewer", robot)
        if controller is not None:
            check_parts(robot, controller.tasks, controller.contacts, None, ())
        place = page_address(host, port)
        self.robot, self.controller = robot, controller
        self.steering = TargetControls()
        self.error = ""
        self._may_steer = steer
        # A single slot, overwritten if it was not read. Storing and taking are atomic operations of
        # the interpreter, so neither thread waits for the other.
        self._news = deque[Update](maxlen=1)
        self._put = self._taken = 0
        self._wishes = deque[TaskRequest]()
        self._requests = deque[Request]()
        self._recorded: WholeRun | None = None
        self._closed, self._asked = threading.Event(), threading.Event()
        self._began: float | None = None
        setup = Setup(robot, title or robot.name, clock, steer, push, terrain, beside)
        self._page = PageProcess(place, setup)
        self.url = f"http://{'localhost' if host == HOST else host}:{self._page.port}"
        self._threads = [
            threading.Thread(target=work, name=f"wbc viewer: {work.__name__[1:]}", daemon=True)
            for work in (self._send, self._listen)
        ]
        for thread in self._threads:
            thread.start()
        atexit.register(self.close)  # else waiting threads would keep their references
        if not quiet:
            print(f"viewer: {self.url}", flush=True)

    def __repr__(self) -> str:
        return f"Viewer({self.robot.name}, {self.url})"

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    # ------------------------------------------------------------------ for the loop

    def show(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Show a configuration (nq,).

        Raises
        ------
        InvalidInputError
            An unusable configuration or velocity.
        """
        self.update(self.robot.snapshot(q, v))

    def update(
        self,
        snapshot: Snapshot,
        tick: Tick | None = None,
        time: float | None = None,
        *,
        seconds: float | None = None,
        phase: str = "",
        remark: str = "",
        playing: bool = True,
        push: Array | None = None,
        pull: PullForce | None = None,
    ) -> None:
        """Show a state and the controller's tick; never waits.

        Applies the user's requests on the page to the controller's tasks.

        Parameters
        ----------
        time:
            Time [s]; by default since the first call.
        seconds:
            Duration of the tick's computation [s], by default as the tick has it.
        phase, remark, playing:
            Shown next to the time: the phase of the run, a remark, and whether it is paused.
        push:
            (3,) force that pushes the robot now [N], world axes.
        pull:
            The user's pull.

        Raises
        ------
        InvalidInputError
            Not a snapshot, or one of another robot; not a tick; a time that is not finite; or a
            phase or remark that is no text.
        """
        check_sizes("Viewer.update", self.robot, snapshot)
        check_kind("Viewer.update, tick", tick, Tick, "controller.step(snapshot)", or_none=True)
        for what, text in (("phase", phase), ("remark", remark)):
            check_word(f"Viewer.update, {what}", text, empty=True)
        at = self._since_first() if time is None else finite_number("Viewer.update, time", time)
        self.steer()
        q, v = snapshot.q, snapshot.v
        frame = Frame(at, q, v, phase=phase, remark=remark, playing=playing, push=push, pull=pull)
        self._news.append(Update(frame, tick, self.controller, seconds))
        self._put += 1

    def steer(self) -> None:
        """Set the targets and weights that the user requested; :meth:`update` does so too.

        A program that sets targets itself in every tick calls this afterwards, before the step.
        """
        controller = self.controller
        if controller is None:
            return
        while self._wishes:
            self.steering.receive(self._wishes.popleft(), controller)
        if self.steering:
            self.steering.apply(controller)

    def next_request(self) -> Request | None:
        """Return the user's next request to the loop, or None."""
        return self._requests.popleft() if self._requests else None

    @property
    def has_wishes(self) -> bool:
        """Whether there are requests for tasks that are not yet applied."""
        return bool(self._wishes)

    def wait_for_user(self, seconds: float = math.inf) -> None:
        """Wait for a request or the page's end, at most for a timeout."""
        self._asked.wait(seconds if math.isfinite(seconds) else None)
        self._asked.clear()  # before requests are read, so that none is missed
        if self.closed:
            self._asked.set()

    def replay(self, frames: Sequence[Frame]) -> None:
        """Show the frames of a whole run instead of those sent during it."""
        self._recorded = WholeRun(tuple(frames))

    def wait(self) -> None:
        """Keep the page open until Ctrl-C, or until it ends."""
        try:
            while not self._closed.wait(0.2):
                pass
        except KeyboardInterrupt:
            self.close()

    def close(self) -> None:
        """Close the page."""
        self._closed.set()
        self._asked.set()
        self._page.disconnect()
        for thread in self._threads:
            thread.join(CLOSING)
        self._page.close()
        atexit.unregister(self.close)

    @property
    def closed(self) -> bool:
        """Whether the page has been closed, or has ended by itself."""
        return self._closed.is_set()

    @property
    def dropped(self) -> int:
        """Number of updates that were not sent because a later one replaced them."""
        return self._put - self._taken - len(self._news)

    def _since_first(self) -> float:
        now = time.monotonic()
        if self._began is None:
            self._began = now
        return now - self._began

    # ------------------------------------------------------------------ threads

    def _send(self) -> None:
        """Send the latest update, at most every :data:`PERIOD`."""
        known: tuple[object, ...] = (None, None, None)
        while not self._closed.wait(PERIOD):
            news = self._news.popleft() if self._news else None
            self._taken += news is not None
            recorded, self._recorded = self._recorded, None
            try:
                if recorded is not None:
                    self._page.send(recorded)
                if news is None:
                    continue
                controller = news.controller
                if controller is not None:
                    parts = (controller, controller.contacts, controller.constraints)
                    if any(a is not b for a, b in zip(known, parts, strict=True)):
                        self._page.send(controller_info(controller))
                        known = parts
                self._page.send(self._frame(news))
            except (OSError, ValueError, pickle.PicklingError) as error:
                self._ended(f"the page has ended: {error}")

    def _frame(self, news: Update) -> Frame:
        controller = news.controller
        return replace(
            news.frame,
            told=None if news.tick is None else tick_info(news.tick, news.seconds),
            targets={} if controller is None else targets_of(controller),
            obstacles={} if controller is None else obstacles_of(controller),
            remark=self.steering.refusal or news.frame.remark,
        )

    def _listen(self) -> None:
        while not self._closed.is_set():
            try:
                message = self._page.receive()
            except (OSError, EOFError):
                self._ended("the page has ended")
                return
            if isinstance(message, Failed):
                self._ended(message.reason)
            elif isinstance(message, TaskRequest):
                if self._may_steer:
                    self._wishes.append(message)
            else:
                self._requests.append(message)
            self._asked.set()

    def _ended(self, reason: str) -> None:
        if not self._closed.is_set():
            self.error = self.error or reason
            self._closed.set()
            self._asked.set()
