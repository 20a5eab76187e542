"""What a walking robot is doing: standing, on both feet between steps, or on one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from wbc.gait.swing import SwingFoot
from wbc.robot import Snapshot
from wbc.validate import Array


class Measured(NamedTuple):
    """What a gait knows of the robot.

    With the centre of pressure at p and the angular momentum k about the CoM, the horizontal motion
    at height h is c'' = omega^2 (c - p) - d/dt (k_y, -k_x) / (M h). So the DCM of the velocity
    c' + (k_y, -k_x) / (M h) obeys xi' = omega (xi - p) - (k_y, -k_x) / (M h): what disturbs it is
    the momentum, small and of zero mean while walking, and not its rate, which would ask for more
    than the length of a sole.

    Attributes
    ----------
    dcm:
        (2,) of the CoM, with the velocity that the angular momentum stands for [m].
    places, rotations:
        Of the soles, by foot: (3,) [m] and (3, 3).
    """

    dcm: Array
    places: dict[str, Array]
    rotations: dict[str, Array]

    @classmethod
    def of(cls, snapshot: Snapshot, frames: dict[str, str], omega: float, height: float) -> Self:
        """Return it of a snapshot; ``frames`` are those of the soles by foot."""
        velocity = snapshot.com_jacobian @ snapshot.v
        kx, ky, _ = snapshot.momentum[3:] / (snapshot.robot.mass * height)
        carried = velocity[:2] + (ky, -kx)
        return cls(
            snapshot.com[:2] + carried / omega,
            {foot: snapshot.position(frame) for foot, frame in frames.items()},
            {foot: snapshot.rotation(frame) for foot, frame in frames.items()},
        )

    @property
    def middle(self) -> Array:
        """Between the feet (3,) [m]."""
        return np.asarray(0.5 * (self.places["left"] + self.places["right"]))

    @property
    def normal(self) -> Array:
        """Of both soles, on average (3,); no unit vector."""
        return np.asarray(0.5 * (self.rotations["left"] + self.rotations["right"])[:, 2])


@dataclass(frozen=True)
class Standing:
    """On both feet, at rest."""


@dataclass(frozen=True)
class DoubleSupport:
    """On both feet, the pressure on its way.

    Attributes
    ----------
    support:
        The foot that will bear.
    start:
        Where the VRP began (2,) [m].
    duration, left:
        [s].
    halts:
        Whether it comes to rest between the feet.
    unloading:
        Whether the other foot is being relieved.
    """

    support: str
    start: Array
    duration: float
    left: float
    halts: bool = False
    unloading: bool = False


@dataclass(frozen=True)
class SingleSupport:
    """On one foot.

    Attributes
    ----------
    support:
        The foot that bears.
    swing:
        The other one.
    elapsed, left:
        Since it began, and until the other foot lands; below zero if that is late [s].
    goal:
        Where it lands (2,) [m].
    offset:
        Of the DCM from there, when that foot alone begins to bear (2,) [m].
    """

    support: str
    swing: SwingFoot
    elapsed: float
    left: float
    goal: Array
    offset: Array


Phase = Standing | DoubleSupport | SingleSupport
