"""The steps of a terrain as triangles: what pictures, reports and the live viewer draw of them."""

from __future__ import annotations

import math

import numpy as np

from wbc.robot.collision import Hull
from wbc.robot.geometry import Surface
from wbc.simulation.terrain import Step, Terrain
from wbc.validate import Array
from wbc.view.solids import solid_surface

ORIGIN = np.zeros(3)


def board_surfaces(
    terrain: Terrain, around: Array = ORIGIN, reach: float = math.inf
) -> list[Surface]:
    """Return the triangles of the steps of a terrain, in world axes.

    Parameters
    ----------
    around, reach:
        A place (2,) or (3,) and how far from it [m], along the axes of each step: only what is in
        there is returned.
    """
    parts = (_within(step, around[:2], reach) for step in terrain.steps)
    return [part for part in parts if part is not None]


def _within(step: Step, around: Array, reach: float) -> Surface | None:
    """Return what a square has of a step; None if nothing."""
    here = (around - step.centre[:2]) @ step.axes
    half = 0.5 * step.size[:2]
    low, high = np.maximum(-half, here - reach), np.minimum(half, here + reach)
    if (low >= high).any():
        return None
    height = float(step.size[2])
    box = Hull.box((*(high - low), height), (*(0.5 * (low + high)), -0.5 * height))
    surface = solid_surface(box, ORIGIN, 0.0, 0.0)
    return Surface(surface.vertices @ step.rotation.T + step.centre, surface.faces)
