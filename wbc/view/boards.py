"""Steps and walls of a terrain as triangles: what pictures, reports and the live viewer draw."""

from __future__ import annotations

import math

import numpy as np

from wbc.gait.walls import WALL_THICKNESS, Wall
from wbc.robot.collision import Hull
from wbc.robot.formats.triangles import Triangles
from wbc.simulation.terrain import Step, Terrain
from wbc.validate import Array
from wbc.view.solids import solid_surface

ORIGIN = np.zeros(3)


def board_surfaces(
    terrain: Terrain, around: Array = ORIGIN, reach: float = math.inf
) -> list[Triangles]:
    """Return the triangles of the steps and walls of a terrain, in world axes.

    Parameters
    ----------
    around, reach:
        A place (2,) or (3,) and how far from it [m], along the axes of each step: only what is in
        there is returned.
    """
    parts = [_within(step, around[:2], reach) for step in terrain.steps]
    parts += [_wall(wall, around[:2], reach) for wall in terrain.walls]
    return [part for part in parts if part is not None]


def _wall(wall: Wall, around: Array, reach: float) -> Triangles | None:
    """Return what of a wall is within reach, to the sides; None if nothing."""
    R, (width, height) = wall.rotation, wall.size.tolist()
    here = float((around - wall.point[:2]) @ R[:2, 1])
    low, high = max(-0.5 * width, here - reach), min(0.5 * width, here + reach)
    if low >= high:
        return None
    middle = (-0.5 * WALL_THICKNESS, 0.5 * (low + high), 0.0)
    box = Hull.box((WALL_THICKNESS, high - low, height), middle)
    surface = solid_surface(box, ORIGIN, 0.0, 0.0)
    return Triangles(surface.vertices @ R.T + wall.point, surface.faces)


def _within(step: Step, around: Array, reach: float) -> Triangles | None:
    """Return what a square has of a step; None if nothing."""
    here = (around - step.centre[:2]) @ step.axes
    half = 0.5 * step.size[:2]
    low, high = np.maximum(-half, here - reach), np.minimum(half, here + reach)
    if (low >= high).any():
        return None
    height = float(step.size[2])
    box = Hull.box((*(high - low), height), (*(0.5 * (low + high)), -0.5 * height))
    surface = solid_surface(box, ORIGIN, 0.0, 0.0)
    return Triangles(surface.vertices @ step.rotation.T + step.centre, surface.faces)
