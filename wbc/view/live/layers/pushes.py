"""Pushes and pulls as arrows: previews of pushes, and forces that act."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from wbc.robot import Robot
from wbc.validate import Array
from wbc.view.live.layers.forces import REACH
from wbc.view.live.layers.layer import GREY, VERMILION, Context, Layer
from wbc.view.live.messages import PUSH_DURATION, PullRobot, ReleasePull, Request
from wbc.view.live.shown_frame import ShownFrame

LONGEST = 0.6  # of the robot's size: the arrow of the largest push
AWAY = 0.25  # of the robot's size: distance of its tip from the CoM, outside the body
LEAST = 1e-3  # of the largest: smaller ones are not drawn
KEY = "shift"  # held while dragging: a drag without it turns the camera


class PushLayer(Layer):
    """An arrow towards the CoM, outside the body: grey as a preview, red while the push acts.

    ``offered``: a function that returns the push (3,) [N s] that the page's button would apply;
    ``largest``: push [N s] that has the longest arrow.
    """

    label = "Push"

    def __init__(self, context: Context, offered: Callable[[], Array], largest: float) -> None:
        super().__init__(context)
        self._offered, self._largest = offered, largest
        self._arrow = self.arrows("arrow", GREY, shaft=0.009, head=0.024, length=0.05)

    def show(self, shown: ShownFrame) -> None:
        """Draw the push that acts, or the preview."""
        force = shown.frame.push
        acts = force is not None and bool(np.any(force))
        impulse = PUSH_DURATION * force if force is not None and acts else self._offered()
        along = LONGEST * self.size / self._largest * impulse
        strength = float(np.linalg.norm(impulse))
        self._arrow.visible = strength > LEAST * self._largest
        if not self._arrow.visible:
            return
        tip = shown.snapshot.com - AWAY * self.size / strength * impulse
        self._arrow.points = np.stack([tip - along, tip])[None].astype(np.float32)
        self._arrow.colors = np.array([VERMILION if acts else GREY], dtype=np.uint8)


class PullLayer(Layer):
    """An arrow from the pulled point, at the scale of the contact forces."""

    label = "Pull"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._stiffness = self.robot.weight / (REACH * self.size)
        self._arrow = self.arrows("arrow", VERMILION, shaft=0.009, head=0.024, length=0.05)

    def show(self, shown: ShownFrame) -> None:
        """Draw the pulling force."""
        pull = shown.frame.pull
        self._arrow.visible = pull is not None
        if pull is not None:
            tip = pull.point + pull.force / self._stiffness
            self._arrow.points = np.stack([pull.point, tip])[None].astype(np.float32)


class Grip:
    """Sends pull requests for the dragged part.

    A spring pulls the grabbed point towards the pointer, in the plane through the point that faces
    the camera. It is as stiff as makes the arrow of its force end at the pointer.

    ``size``: of the robot [m].
    ``links``: name of the link, and the node, of each shape that can be grabbed.
    ``send``: told of each drag, by :class:`PullRobot`, and of its end, by :class:`ReleasePull`.
    """

    def __init__(
        self,
        size: float,
        robot: Robot,
        links: Iterable[tuple[str, Any]],
        send: Callable[[Request], None],
    ) -> None:
        self._send = send
        self._stiffness = robot.weight / (REACH * size)
        self._changing = threading.Lock()  # drags are told by another thread than shows
        self._shown: ShownFrame | None = None
        self._link = ""  # what is grabbed; empty: nothing
        self._point = np.zeros(3)  # of the link, in its axes
        self._pointer = np.zeros(3)  # from the page's origin [m], world axes
        for link, mesh in links:
            self._make_grabbable(link, mesh)

    def _make_grabbable(self, link: str, mesh: Any) -> None:
        async def dragged(event: Any) -> None:  # async: in the order in which it happened
            with self._changing:
                if event.phase == "end":
                    self._link = ""
                    self._send(ReleasePull())
                    return
                if event.phase == "start" and self._shown is not None:
                    self._grab(link, np.array(event.start_position), self._shown)
                if self._link and self._shown is not None:
                    self._pointer = np.array(event.end_position)
                    self._pull(self._shown.followed)

        mesh.on_drag("left", modifier=KEY)(dragged)

    def _grab(self, link: str, place: Array, shown: ShownFrame) -> None:
        """Grab a link at a place (3,) from the page's origin."""
        R, p = shown.snapshot.rotation(link), shown.snapshot.position(link)
        self._link, self._point = link, R.T @ (place + shown.followed - p)

    def _pull(self, followed: Array) -> None:
        target = self._pointer + followed
        self._send(PullRobot(self._link, self._point, target, self._stiffness))

    def show(self, shown: ShownFrame) -> None:
        """Update for a frame; a resting pointer moves through the world with the view."""
        with self._changing:
            before, self._shown = self._shown, shown
            if self._link and before is not None and (shown.followed != before.followed).any():
                self._pull(shown.followed)
