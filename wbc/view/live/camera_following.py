"""The view follows the robot: the point of the ground that is shown at the page's origin.

The scene is moved, not the camera: only the page knows its camera while the user turns it, so a
camera moved by the server would jump back. Pointer positions from the page are relative to its
origin; handles of targets, below the moved node, are in world axes.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from viser import GuiApi

from wbc.simulation.terrain import Terrain
from wbc.validate import Array

FREE_RADIUS = 0.15  # of the robot's size: a CoM this near to the point does not move it
TIME_CONSTANT = 0.25  # s: of what is beyond that; steps sway the view by a third of the CoM's sway
TIME_GAP = 1.0  # s: after a longer gap, or backwards in time, the point jumps to the CoM


class Following:
    """The point that is followed, and the box that turns it on and off.

    A robot that stands about the world's origin leaves the view as it is without following.

    ``size``: of the robot [m].
    ``terrain``: the point is on its plane, below its steps.
    ``changed``: called when the user has changed the box.

    ``point``: (3,) [m], world axes; where it was when the box is not ticked.
    """

    def __init__(
        self, gui: GuiApi, size: float, terrain: Terrain, changed: Callable[[], None]
    ) -> None:
        self.point: Array = np.zeros(3)
        self._slack, self._slope = FREE_RADIUS * size, np.array(terrain.slope)
        self._time = math.nan  # of the last call [s]
        self._box = gui.add_checkbox(
            "Follow the robot", True, hint="Horizontally; the camera turns and zooms as before."
        )

        def toggle(_: object) -> None:
            self._time = math.nan  # the robot may be far away by now
            changed()

        self._box.on_update(toggle)

    def follow(self, com: Array, time: float) -> None:
        """Move the point towards the CoM (3,) [m] of a frame, whose time is in s."""
        if not self._box.value:
            return
        elapsed, self._time = time - self._time, time
        here, com = self.point[:2], com[:2]
        away = com - here
        distance = float(np.linalg.norm(away))
        if not 0.0 <= elapsed < TIME_GAP:
            here = np.zeros(2) if np.linalg.norm(com) <= self._slack else com
        elif distance > self._slack:
            part = -math.expm1(-elapsed / TIME_CONSTANT)
            here = here + part * (1.0 - self._slack / distance) * away
        self.point = np.append(here, self._slope @ here)
