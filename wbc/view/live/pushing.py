"""What the page offers to push a robot with: how strongly, which way, and the button."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from viser import GuiApi

from wbc.validate import Array
from wbc.view.live.messages import PushRobot, Request

FIRST = 0.25  # of the largest push: what the slider begins with
STEPS = 100  # of the slider
HINT = "Or hold Shift and drag a part of the robot: it is pulled towards the pointer."
_STYLE = "font-size:0.8em;line-height:1.35;padding:0 0.9em 0.4em;color:#555"


class PushControls:
    """Strength and direction of a push at the CoM, along the ground, and what gives it."""

    def __init__(self, gui: GuiApi, send: Callable[[Request], None], largest: float) -> None:
        step = float(f"{largest / STEPS:.1g}")
        count = round(largest / step)
        first = float(f"{step * round(FIRST * count):.6g}")  # 1.82, not 1.8200000000000001
        with gui.add_folder("Push"):
            self._impulse = gui.add_slider("Impulse [N s]", 0.0, step * count, step, first)
            self._angle = gui.add_slider(
                "Direction [deg]", -180.0, 180.0, 5.0, 0.0, hint="0: forwards, 90: to the left."
            )
            button = gui.add_button("Push", hint="At the CoM, for a tenth of a second.")
            gui.add_html(f"<div style='{_STYLE}'>{HINT}</div>")
        button.on_click(lambda _: send(PushRobot(self.impulse)))

    @property
    def impulse(self) -> Array:
        """The push that the button would give (3,) [N s]."""
        angle = np.radians(self._angle.value)
        way = np.array((np.cos(angle), np.sin(angle), 0.0))
        return np.asarray(self._impulse.value * way)
