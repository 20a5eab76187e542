"""The reaction mass pendulum: leg, CoP, CMP, ellipsoid, masses, momentum (paper Figs. 4, 5)."""

from __future__ import annotations

import numpy as np

from wbc.view.live.layers.layer import (
    BLACK,
    BLUE,
    ORANGE,
    PRINCIPAL,
    PURPLE,
    SKY,
    Context,
    Layer,
    along,
    place_ellipsoid,
)
from wbc.view.live.shown_frame import ShownFrame

AHEAD = 0.5  # s: a momentum arrow is as long as the CoM's way in this time
LEVER = 0.25  # of the robot's size: an angular momentum arrow at 1 rad/s of mean angular velocity


class EllipsoidLayer(Layer):
    """The equimomental ellipsoid: of the robot's mass and inertia, uniform."""

    label = "Ellipsoid"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._ball = self.scene.add_icosphere(
            f"{self.path}/surface",
            1.0,
            BLUE,
            subdivisions=5,
            opacity=0.3,
            side="back",  # only its far side is drawn, so that it does not hide the robot
            cast_shadow=False,
            receive_shadow=False,
        )
        self._rings = self.rings("sections", BLUE, thickness=1.5)

    def show(self, shown: ShownFrame) -> None:
        """Set its size and orientation."""
        for node in (self._ball, self._rings):
            place_ellipsoid(node, shown.state.ellipsoid, shown.state.com)


class MassesLayer(Layer):
    """Six masses M/6 with the same inertia as the robot."""

    label = "Reaction masses"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._balls = [
            self.scene.add_icosphere(
                f"{self.path}/{k} {sign:+d}", 0.018 * self.size, colour, cast_shadow=False
            )
            for k, colour in enumerate(PRINCIPAL)
            for sign in (-1, 1)
        ]
        self._tracks = self.scene.add_line_segments(
            f"{self.path}/tracks",
            np.zeros((3, 2, 3)),
            np.repeat(np.array(PRINCIPAL, dtype=np.uint8)[:, None], 2, axis=1),
            thickness=0.004 * self.size,
        )

    def show(self, shown: ShownFrame) -> None:
        """Move the masses along their axes."""
        state = shown.state
        reach = state.axes.T * state.radii[:, None]  # (3, 3), a row per axis
        ends = state.com + np.stack([-reach, reach], axis=1)
        for ball, place in zip(self._balls, ends.reshape(-1, 3), strict=True):
            ball.position = place
        self._tracks.points = ends.astype(np.float32)


class LegLayer(Layer):
    """The leg from the CoP to the CoM, the CoP and the CMP; a floating robot has none of them."""

    label = "Leg CoP CMP"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        scene, size = self.scene, self.size
        self._leg = self.lines("leg", BLACK, thickness=0.008)
        level = along(self.terrain.normal)
        disc = {"cast_shadow": False, "receive_shadow": False, "wxyz": level}
        self._cop = scene.add_cylinder(f"{self.path}/cop", 0.02 * size, 0.003, ORANGE, **disc)
        self._cmp = scene.add_cylinder(f"{self.path}/cmp", 0.014 * size, 0.004, PURPLE, **disc)
        self._names = [
            scene.add_label(f"{self.path}/{name} name", name, font_screen_scale=0.8, anchor=anchor)
            for name, anchor in (("CoP", "top-left"), ("CMP", "bottom-right"))
        ]

    def show(self, shown: ShownFrame) -> None:
        """Draw them if there are contact forces."""
        state = shown.state
        known = shown.has_ground and state.cop is not None and state.cmp is not None
        cop_name, cmp_name = self._names
        self._leg.visible = self._cop.visible = cop_name.visible = known
        apart = known and not state.quasi_static
        self._cmp.visible = cmp_name.visible = apart
        if state.cop is None or state.cmp is None:
            return
        cop, cmp = shown.on_ground(state.cop), shown.on_ground(state.cmp)
        self._leg.points = np.stack([cop, state.com])[None].astype(np.float32)
        self._cop.position = cop_name.position = cop
        self._cmp.position = cmp_name.position = cmp
        cop_name.text = "CoP (at rest)" if state.quasi_static else "CoP"


class MomentumLayer(Layer):
    """Linear and angular momentum, as arrows from the CoM."""

    label = "Momentum"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._arrows = self.arrows("arrows", SKY, shaft=0.006, head=0.015, length=0.035)

    def show(self, shown: ShownFrame) -> None:
        """Draw the CoM's way under the linear momentum, and the axis of the angular one."""
        state = shown.state
        ways = np.stack(
            [AHEAD * state.com_velocity, LEVER * self.size * state.average_angular_velocity]
        )
        long = np.linalg.norm(ways, axis=1) > 0.02 * self.size
        self._arrows.visible = bool(long.any())
        # An arrow of zero length would still have a head: it is hidden inside the CoM's ball.
        ways[~long] = 0.0
        self._arrows.points = np.stack([np.broadcast_to(state.com, (2, 3)), state.com + ways], 1)
        self._arrows.colors = np.array([SKY, PURPLE], dtype=np.uint8)
