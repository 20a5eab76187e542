"""Pushes and pulls as arrows: what is offered, what acts, and the parts that the user drags."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from viser import SceneApi

from wbc.robot import Robot
from wbc.validate import Array
from wbc.view.live.layers.forces import REACH
from wbc.view.live.layers.layer import GREY, VERMILION, Layer
from wbc.view.live.layers.robot import RobotLayer
from wbc.view.live.messages import PUSH_DURATION, LetGo, PullRobot, Request
from wbc.view.live.shown import Shown

LONGEST = 0.6  # of the robot's size: the arrow of the largest push
AWAY = 0.25  # of the robot's size: how far from the CoM it ends, where the body does not hide it
LEAST = 1e-3  # of the largest: smaller ones are not drawn
KEY = "shift"  # held while dragging: a drag without it turns the camera


class PushLayer(Layer):
    """An arrow towards the CoM, outside the body: grey while only offered, red while it acts.

    Parameters
    ----------
    offered:
        Returns the push that the page's button would give (3,) [N s].
    largest:
        Push [N s] whose arrow is the longest.
    """

    label = "Push"

    def __init__(
        self, scene: SceneApi, size: float, offered: Callable[[], Array], largest: float
    ) -> None:
        super().__init__(scene, size)
        self._offered, self._largest = offered, largest
        self._arrow = self.arrows("arrow", GREY, shaft=0.009, head=0.024, length=0.05)

    def show(self, shown: Shown) -> None:
        """Draw the push that acts, or the one that is offered."""
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
    """An arrow from what is pulled, to the scale of the contact forces.

    A spring pulls the grabbed point towards the pointer, in the plane through the point that faces
    the camera. It is as stiff as makes the arrow end at the pointer.

    Parameters
    ----------
    grabbed:
        Whose parts can be grabbed.
    send:
        Told of each drag, by :class:`PullRobot`, and of its end, by :class:`LetGo`.
    """

    label = "Pull"

    def __init__(
        self,
        scene: SceneApi,
        size: float,
        robot: Robot,
        grabbed: RobotLayer,
        send: Callable[[Request], None],
    ) -> None:
        super().__init__(scene, size)
        self._send = send
        self._stiffness = robot.weight / (REACH * size)
        self._shown: Shown | None = None
        self._point = np.zeros(3)  # what is grabbed, in the axes of its link
        self._arrow = self.arrows("arrow", VERMILION, shaft=0.009, head=0.024, length=0.05)
        for link, mesh in grabbed.links:
            self._make_grabbable(link, mesh)

    def _make_grabbable(self, link: str, mesh: Any) -> None:
        async def dragged(event: Any) -> None:  # async: in the order in which it happened
            shown = self._shown
            if event.phase == "end":
                self._send(LetGo())
            elif shown is not None:
                if event.phase == "start":
                    R, p = shown.snapshot.rotation(link), shown.snapshot.position(link)
                    self._point = R.T @ (np.array(event.start_position) - p)
                target = np.array(event.end_position)
                self._send(PullRobot(link, self._point, target, self._stiffness))

        mesh.on_drag("left", modifier=KEY)(dragged)

    def show(self, shown: Shown) -> None:
        """Draw the force that pulls."""
        self._shown, pull = shown, shown.frame.pull
        self._arrow.visible = pull is not None
        if pull is not None:
            tip = pull.point + pull.force / self._stiffness
            self._arrow.points = np.stack([pull.point, tip])[None].astype(np.float32)
