"""Where the sole that bears can be pressed: less than all of it, where it stands over an edge."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from wbc.validate import Array

# A sole that has turned by this angle [rad] tips: ten times the noise of good sensors.
TIPPED = 0.03
# It is then pressed so much farther in than it was felt to be, in units of its half size.
BACK = 0.1
# What bears less than this part of the weight says nothing.
LEAST_LOAD = 0.1


@dataclass(frozen=True)
class Foothold:
    """The part of a sole on which it is known to stand: at first all of it.

    A sole that is pressed beyond the edge it stands on tips about that edge, and lifts the pelvis,
    so that the other foot hangs above the ground while the capture point runs away. One that tips
    is pressed no farther out than it was felt to be then, as the pressure is on the edge. After
    Wiedebach et al., "Walking on partial footholds including line contacts with the humanoid robot
    Atlas", Humanoids 2016.

    Attributes
    ----------
    normal:
        (3,) of the sole as it stood flat, a unit vector.
    lower, upper:
        (2,) corners of that part in the sole's axes, from its middle [m].
    half:
        (2,) half sizes of the sole [m].
    """

    normal: Array
    lower: Array
    upper: Array
    half: Array

    @classmethod
    def whole(cls, rotation: Array, half: Array) -> Self:
        """Return that of a sole that stands flat now, with axes (3, 3) and half sizes (2,)."""
        return cls(rotation[:, 2], -half, half, half)

    def felt(self, rotation: Array, wrench: Array, weight: float) -> Self:
        """Return what is known of it now.

        Parameters
        ----------
        rotation:
            (3, 3) of the sole.
        wrench:
            (6,) on it, about its middle, world axes [N, N m].
        weight:
            Of the robot [N].
        """
        # What of the flat normal points ahead and aside: a sole that tips ahead leans back from it.
        ahead = rotation[:, :2].T @ self.normal
        force, moment = rotation.T @ wrench[:3], rotation.T @ wrench[3:]
        if force[2] < LEAST_LOAD * weight or np.abs(ahead).max() < TIPPED:
            return self
        pressed = np.array((-moment[1], moment[0])) / force[2]
        inside = np.clip(pressed, self.lower, self.upper)
        upper = np.where(ahead < -TIPPED, inside - BACK * self.half, self.upper)
        lower = np.where(ahead > TIPPED, inside + BACK * self.half, self.lower)
        # Not past the other side.
        upper, lower = np.maximum(upper, self.lower), np.minimum(lower, self.upper)
        return replace(self, lower=lower, upper=upper)

    def nearest(self, point: Array) -> Array:
        """Return the point (2,) of it that is nearest to one in the sole's axes [m]."""
        return np.clip(point, self.lower, self.upper)
