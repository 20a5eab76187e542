"""The ground, the soles, the support polygon, and the CoM with its projection."""

from __future__ import annotations

import numpy as np

from wbc.rotations import rotation_from
from wbc.view import palette
from wbc.view.live.layers.layer import BLACK, GREY, ORANGE, SKY, Context, Layer, along, closed
from wbc.view.live.shown_frame import ShownFrame
from wbc.view.solids import board_surfaces

# Of drawings above the ground [m], at whose height they would flicker.
GROUND_OFFSET = np.array([0.0, 0.0, 1e-3])


class GroundLayer(Layer):
    """A grid on the ground's plane, with the shadow of the robot, and boards on it.

    The grid seems infinite: it follows the view in whole sections.
    """

    label = "Ground"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        cell = 0.1 if self.size > 0.8 else 0.05
        self._section = 5.0 * cell
        self._grid = self.scene.add_grid(
            f"{self.path}/grid",
            width=8.0 * self.size,
            height=8.0 * self.size,
            cell_size=cell,
            section_size=self._section,
            cell_color=(222, 226, 230),
            section_color=(190, 196, 202),
            fade_distance=6.0 * self.size,
            shadow_opacity=0.25,
            plane_color=(246, 247, 249),
            plane_opacity=1.0,
            wxyz=along(self.terrain.normal),
        )
        self._axes = rotation_from(np.roll(self._grid.wxyz, -1))
        for number, surface in enumerate(board_surfaces(self.terrain)):
            self.mesh(f"board {number}", surface, palette.rgb(palette.BOARD), flat_shading=True)

    def show(self, shown: ShownFrame) -> None:
        """Move the grid below the view's target by whole sections, so that its lines seem fixed."""
        sections = np.round(self._axes.T @ shown.followed / self._section)
        self._grid.position = self._axes @ (*(self._section * sections[:2]), 0.0)


class SupportLayer(Layer):
    """The soles, orange where in contact, and the support polygon."""

    label = "Soles and support"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._soles = {name: self.lines(name, GREY, thickness=0.004) for name in self.robot.feet}
        self._polygon = self.lines("polygon", SKY, thickness=0.006)

    def show(self, shown: ShownFrame) -> None:
        """Draw the outlines of soles and polygon."""
        standing = {foot.name for foot in shown.standing}
        for foot in shown.robot.feet.values():
            lines = self._soles[foot.name]
            corners = shown.sole(foot) + GROUND_OFFSET
            lines.points = closed(corners).astype(np.float32)
            colour = ORANGE if foot.name in standing else GREY
            lines.colors = np.array(colour, dtype=np.uint8)
        polygon = shown.polygon
        self._polygon.visible = polygon is not None
        if polygon is not None:
            corners = shown.on_ground(polygon) + GROUND_OFFSET
            self._polygon.points = closed(corners).astype(np.float32)


class ComLayer(Layer):
    """The CoM, and its projection on the ground."""

    label = "CoM"

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._ball = self.scene.add_icosphere(
            f"{self.path}/com", 0.016 * self.size, BLACK, cast_shadow=False, receive_shadow=False
        )
        self._foot = self.scene.add_cylinder(
            f"{self.path}/projection",
            0.012 * self.size,
            0.002,
            BLACK,
            cast_shadow=False,
            wxyz=along(self.terrain.normal),
        )
        self._plumb = self.lines("plumb", GREY, thickness=0.002)

    def show(self, shown: ShownFrame) -> None:
        """Move the CoM and its marks on the ground."""
        com = shown.snapshot.com
        below = shown.on_ground(com) + GROUND_OFFSET
        self._ball.position = com
        self._foot.visible = self._plumb.visible = shown.has_ground
        self._foot.position = below
        self._plumb.points = np.stack([com, below])[None].astype(np.float32)
