"""The robot at a few moments of a motion, each with its pendulum standing on the CoP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes

from wbc.constraints.support_polygon import support_polygon
from wbc.motion import RmpSeries
from wbc.rmp import Ellipsoid
from wbc.validate import Array
from wbc.view import shapes, style
from wbc.view.analysis_plots import LETTERS
from wbc.view.camera import Camera
from wbc.view.panel import Panel
from wbc.view.portrait import AZIMUTH, ELEVATION, INCH, Portrait, portraits_of, shape_of
from wbc.view.render import render

RADIUS_WIDTH = 0.44  # inches, of a radius as written below a picture
FULL_SIZE = 0.39  # inches that a radius needs for full size
TINY, TINIEST = 6.5, 5.0  # points, of the radii, where there is room and where there is not


@dataclass(frozen=True, eq=False)
class Moment:
    """The robot in one frame.

    Attributes
    ----------
    portrait:
        Robot, ellipsoid and CoM.
    cop:
        Centre of pressure (3,) [m]; None in flight.
    support:
        Corners (k, 3) [m] of the support polygon, closed; None if no foot stands.
    radii:
        r_k (3,) [m] along the ellipsoid's axes.
    """

    portrait: Portrait
    cop: Array | None
    support: Array | None
    radii: Array


def moments_of(series: RmpSeries, frames: Sequence[int]) -> list[Moment]:
    """Return some frames of a motion, ready to be drawn."""
    names = {
        f"{letter})  {series.time[frame]:.2f} s": series.q[frame]
        for letter, frame in zip(LETTERS, frames, strict=False)
    }
    portraits = portraits_of(series.robot, names)
    return [_moment(series, k, one) for k, one in zip(frames, portraits, strict=True)]


def _moment(series: RmpSeries, frame: int, portrait: Portrait) -> Moment:
    # The tracked axes, so that an axis has one colour in all pictures and plots.
    ellipsoid = Ellipsoid(series.semi_axes[frame], series.axes[frame], series.robot.mass)
    scene = replace(portrait.scene, ellipsoid=ellipsoid, ground=series.ground_height)
    stands = series.standing[frame]
    support = None
    if stands.any():
        feet = [name for name, on in zip(series.feet, stands, strict=True) if on]
        corners = support_polygon(portrait.snapshot, feet)
        closed = np.concatenate((corners, corners[:1]))
        support = np.column_stack((closed, np.full(len(closed), series.ground_height)))
    cop = None if series.flight[frame] else series.cop[frame]
    return Moment(replace(portrait, scene=scene), cop, support, series.radii[frame])


def shape_of_moments(moments: Sequence[Moment]) -> float:
    """Return the ratio of height to width of a picture that the moments fill."""
    return shape_of([moment.portrait for moment in moments])


def draw_moments(
    panels: Sequence[Axes], moments: Sequence[Moment], size: tuple[float, float]
) -> None:
    """Draw each moment on axes of its own, of one size [inches], from one side and at one scale."""
    pixels = round(size[0] * style.DPI), round(size[1] * style.DPI)
    extent = np.concatenate([moment.portrait.extent for moment in moments])
    camera = Camera.framing(extent, AZIMUTH, ELEVATION, *pixels)
    for axes, moment in zip(panels, moments, strict=True):
        _draw(axes, moment, camera.moved(moment.portrait.below_com))


def _draw(axes: Axes, moment: Moment, camera: Camera) -> None:
    scene = moment.portrait.scene
    panel = Panel(axes, camera, render(scene, camera), style.DPI / INCH)
    panel.show()
    if moment.support is not None:
        panel.curve(shapes.densified(moment.support), style.ORANGE, 1.4, hidden=0.6)
    outline = shapes.silhouette(scene.ellipsoid, scene.centre, camera.eye)
    panel.curve(outline, style.BLUE, 0.9, hidden=0.35)
    _draw_pendulum(panel, moment)
    axes.set_xlim(0.0, camera.width)
    axes.set_ylim(camera.height, 0.0)
    axes.set_title(moment.portrait.name, fontsize=style.SMALL, color=style.BLACK, pad=3)
    _write_radii(axes, moment.radii, camera.width / style.DPI)


def _draw_pendulum(panel: Panel, moment: Moment) -> None:
    """Draw the leg from the CoP to the CoM and the reaction masses; no leg in flight."""
    centre, ellipsoid = moment.portrait.scene.centre, moment.portrait.scene.ellipsoid
    if moment.cop is not None:
        panel.line(moment.cop, centre, style.BLACK, 1.7)
    for k, colour in enumerate(style.PRINCIPAL):
        axis, reach = ellipsoid.axes[:, k], ellipsoid.semi_axes[k]
        panel.line(centre - reach * axis, centre + reach * axis, colour, 0.7)
        for distance in (-moment.radii[k], moment.radii[k]):
            panel.ball(centre + distance * axis, colour, 2.2)
    if moment.cop is not None:
        panel.ball(moment.cop, style.BLACK, 2.2)
    panel.centre_of_mass(centre, 3.8)


def _write_radii(axes: Axes, radii: Array, width: float) -> None:
    # Closer to each other than to those of the next picture.
    apart = min(RADIUS_WIDTH / width, 0.31)
    size = max(TINIEST, TINY * min(1.0, apart * width / FULL_SIZE))
    for k, colour in enumerate(style.PRINCIPAL):
        axes.text(
            0.5 + apart * (k - 1),
            -0.02,
            f"r{style.INDEX[k]} {1e3 * radii[k]:.0f}",
            color=colour,
            fontsize=size,
            fontweight="bold",
            ha="center",
            va="top",
            transform=axes.transAxes,
        )
