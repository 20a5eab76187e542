"""Pushes and pulls as arrows: previews of pushes, and forces that act."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wbc.validate import Array
from wbc.view.live.layers.forces import REACH
from wbc.view.live.layers.layer import GREY, VERMILION, Context, Layer
from wbc.view.live.messages import PUSH_DURATION
from wbc.view.live.shown_frame import ShownFrame

LONGEST = 0.6  # of the robot's size: the arrow of the largest push
AWAY = 0.25  # of the robot's size: distance of its tip from the CoM, outside the body
LEAST = 1e-3  # of the largest: smaller ones are not drawn


class PushLayer(Layer):
    """An arrow towards the CoM, outside the body: grey as a preview, red while the push acts.

    Parameters
    ----------
    offered:
        A function that returns the push (3,) [N s] that the page's button would apply.
    largest:
        Push [N s] that has the longest arrow.
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
