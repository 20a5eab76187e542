"""What a pendulum did, in space: one form for simulations and plans, planar and solid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from wbc.validate import Array


class Support(NamedTuple):
    """Where the ground may push for a while."""

    start: float  # [s]
    end: float  # [s]
    polygon: Array  # (k, 2) [m], anticlockwise; two corners for a planar pendulum


@dataclass(frozen=True, eq=False)
class PendulumHistory:
    """A pendulum's motion in space (x, y, z), z up; a planar one moves in y = 0.

    Attributes
    ----------
    flat:
        Whether the pendulum is planar.
    time:
        (n,) [s].
    phase:
        What the law or the schedule calls each moment (n,).
    com, com_velocity:
        (n, 3) [m], [m/s].
    foot:
        Lower end of the leg (n, 3) [m]; NaN in flight.
    cop, cmp:
        Where the ground pushes, and where its force through the CoM meets the ground (n, 3) [m];
        NaN in flight, and at the end of a simulation, where nothing is commanded any more.
    radii:
        Distances r_k of the masses (n, 3) [m]; a planar pendulum has (r, 0, 0).
    axes:
        Axes of the masses as columns of rotation matrices (n, 3, 3).
    momentum:
        Angular momentum k_G about the CoM (n, 3) [kg m^2/s].
    supports:
        Support polygons, in order of time.
    """

    flat: bool
    time: Array
    phase: tuple[str, ...]
    com: Array
    com_velocity: Array
    foot: Array
    cop: Array
    cmp: Array
    radii: Array
    axes: Array
    momentum: Array
    supports: tuple[Support, ...]
