"""Where the sole that bears can be pressed: less than all of it, where it stands over an edge."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from wbc.validate import Array

# A sole that has turned by this angle [rad] tips: ten times the noise of good sensors.
TIPPED = 0.03
# It goes on tipping as it turns by so much more [rad], until it has turned back by half.
GROWS = 0.003
# It is then pressed so much farther in than it was felt to be, in units of its half size.
BACK = 0.1
# What bears less than this part of the weight says nothing.
LEAST_LOAD = 0.1


class Foothold(NamedTuple):
    """The part of a sole on which it is known to stand: at first all of it.

    A sole that is pressed beyond the edge it stands on tips about that edge, and lifts the pelvis,
    so that the other foot hangs above the ground while the capture point runs away. One that tips
    is pressed no farther out than it was felt to be then, as the pressure is on the edge. After
    Wiedebach et al., "Walking on partial footholds including line contacts with the humanoid robot
    Atlas", Humanoids 2016.

    A sole that landed in a hurry stands on an edge at first, and turns as it settles. So it tips
    where it turns both from how it stood and from level ground. One that turns back is pressed
    anywhere, and says nothing: a G1 that was pushed from behind tipped over its toes, and where it
    was pressed as they fell back took 13 cm of 17 from the rest of the step. So only a tip that
    grows is one.

    Attributes
    ----------
    normal:
        (3,) of the sole as the other foot left the ground, a unit vector.
    level:
        (3,) of the ground, as far as it is known, a unit vector.
    lower, upper:
        (2,) corners of that part in the sole's axes, from its middle [m].
    half:
        (2,) half sizes of the sole [m].
    tipped:
        (2,) how far the unit normal has turned on its axes since it tips; 0: it does not.
    """

    normal: Array
    level: Array
    lower: Array
    upper: Array
    half: Array
    tipped: Array

    @classmethod
    def whole(cls, rotation: Array, level: Array, half: Array) -> Self:
        """Return all of a sole with axes (3, 3) and half sizes (2,), on ground of a normal (3,)."""
        return cls(rotation[:, 2], level, -half, half, half, np.zeros(2))

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
        # What of a normal points ahead and aside: a sole that tips ahead leans back from it.
        ahead = self.normal.dot(rotation[:, :2])
        if max(map(abs, ahead.tolist())) <= TIPPED and not any(self.tipped.tolist()):
            return self  # it stands as it stood
        level = self.level.dot(rotation[:, :2])
        way = np.sign(ahead)
        angle = np.minimum(way * ahead, way * level)
        tips = angle > np.maximum(way * self.tipped + GROWS, TIPPED)
        ended = (angle < 0.5 * TIPPED) & (self.tipped != 0.0)
        force, moment = rotation.T @ wrench[:3], rotation.T @ wrench[3:]
        if force[2] < LEAST_LOAD * weight or not (tips | ended).any():
            return self
        tipped = np.where(tips, way * angle, np.where(ended, 0.0, self.tipped))
        pressed = np.array((-moment[1], moment[0])) / force[2]
        upper = np.where(tips & (way < 0.0), pressed - BACK * self.half, self.upper)
        lower = np.where(tips & (way > 0.0), pressed + BACK * self.half, self.lower)
        # Less than before, and not past the other side.
        upper = np.clip(upper, self.lower, self.upper)
        lower = np.clip(lower, self.lower, upper)
        return self._replace(lower=lower, upper=upper, tipped=tipped)

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """Return the point of it that is nearest to one in the sole's axes [m]."""
        (left, low), (right, high) = self.lower.tolist(), self.upper.tolist()
        return min(max(x, left), right), min(max(y, low), high)
