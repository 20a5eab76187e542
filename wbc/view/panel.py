"""Lines and marks over a rendered picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, RegularPolygon, Wedge

from wbc.validate import Array
from wbc.view.camera import Camera
from wbc.view.render import Picture
from wbc.view.style import BLACK

CASING = "white"  # around lines and marks, so that they show on any ground
TOUCHING = 0.01  # m: a line no further than this behind a surface lies on it
LINES, MARKS, FRONT = 2, 3, 4  # drawing order


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes whose coordinates are the pixels of a picture; lengths given are points of type."""

    axes: Axes  # where to draw
    camera: Camera  # where the picture was taken from
    picture: Picture
    point: float  # pixels in a point of type (1/72 inch)

    def show(self) -> None:
        """Draw the picture itself."""
        width, height = self.camera.width, self.camera.height
        self.axes.imshow(self.picture.colours, extent=(0.0, width, height, 0.0), aspect="equal")
        self.axes.set_axis_off()
        self.axes.set_xlim(0.0, width)
        self.axes.set_ylim(height, 0.0)

    def curve(self, points: Array, colour: str, width: float, hidden: float = 0.0) -> None:
        """Draw a curve (k, 3), with the strength ``hidden`` where the robot is in front of it."""
        pixels, depth = self.camera.project(points)
        last = np.array([self.camera.width, self.camera.height]) - 1
        column, row = np.clip(pixels.astype(int), 0, last).T
        ahead = depth < self.picture.depth[row, column] + TOUCHING
        strength = np.where(ahead[:-1] & ahead[1:], 1.0, hidden)
        lines = LineCollection(
            list(np.stack([pixels[:-1], pixels[1:]], axis=1)),
            colors=colour,
            linewidths=width,
            alpha=strength.tolist(),
            zorder=LINES,
        )
        self.axes.add_collection(lines)

    def line(self, start: Array, end: Array, colour: str, width: float) -> None:
        """Draw a straight line between two points (3,), over everything."""
        x, y = self.camera.project(np.stack([start, end]))[0].T
        for shade, extra in ((CASING, 1.2), (colour, 0.0)):
            self.axes.plot(
                x, y, color=shade, linewidth=width + extra, solid_capstyle="round", zorder=LINES
            )

    def arrow(self, start: Array, end: Array, colour: str, width: float) -> None:
        """Draw an arrow between two points (3,), over everything."""
        self.axes.annotate(
            "",
            self._pixel(end),
            self._pixel(start),
            arrowprops={"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0.0,
                        "shrinkB": 0.0},
            zorder=MARKS,
        )  # fmt: skip

    def ball(self, point: Array, colour: str, radius: float) -> None:
        """Draw a dot at a point (3,), over everything."""
        size = radius * self.point
        self.axes.add_patch(
            Circle(self._pixel(point), size, fc=colour, ec=CASING, lw=0.8, zorder=MARKS)
        )

    def target(self, point: Array, wanted: Array, colour: str, radius: float) -> None:
        """Draw a diamond where a point (3,) is wanted, and a dotted line that leads there."""
        (x0, y0), (x, y) = self._pixel(point), self._pixel(wanted)
        self.axes.plot((x0, x), (y0, y), ":", color=BLACK, linewidth=0.9, zorder=LINES)
        size = radius * self.point
        self.axes.add_patch(
            RegularPolygon((x, y), 4, radius=size, fc=colour, ec=BLACK, lw=0.9, zorder=FRONT)
        )

    def centre_of_mass(self, point: Array, radius: float) -> None:
        """Draw the quartered disc that marks a CoM."""
        pixel, size = self._pixel(point), radius * self.point
        self.axes.add_patch(Circle(pixel, size, fc="white", ec=BLACK, lw=1.0, zorder=FRONT))
        for start in (0.0, 180.0):
            self.axes.add_patch(Wedge(pixel, size, start, start + 90.0, fc=BLACK, zorder=FRONT))

    def _pixel(self, point: Array) -> tuple[float, float]:
        (x, y) = self.camera.project(point[None])[0][0].tolist()
        return x, y
