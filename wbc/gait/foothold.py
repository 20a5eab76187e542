"""The part of the stance sole that can bear pressure: less than all of it on an edge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from wbc.validate import Array

# A sole that has turned by this angle [rad] is tipping: ten times the noise of good sensors.
TIP_ANGLE = 0.03
# It is tipping further when it turns by this much more [rad], and has settled when back by half.
TIP_GROWTH = 0.003
# Distance of the new edge from the CoP measured then, inwards, in half sizes of the sole.
EDGE_MARGIN = 0.1
# A sole that bears less than this part of the weight gives no estimate.
MIN_LOAD = 0.1

Rotation = Sequence[Sequence[float]]  # three rows of three numbers


class Foothold(NamedTuple):
    """The part of a sole on which it is known to stand: at first all of it.

    A sole that is pressed beyond the edge it stands on tips about that edge and lifts the pelvis,
    so that the swing foot hangs above the ground while the capture point diverges. While it tips,
    the CoP is on the edge: it is asked for no farther out from then on. After Wiedebach et al.,
    "Walking on partial footholds including line contacts with the humanoid robot Atlas", Humanoids
    2016.

    A sole that landed early stands on an edge at first, and turns as it settles: so it is tipping
    only where it turns both from its rotation at lift-off and from level ground. Only a growing
    angle counts: in a G1 that was pushed from behind and tipped over its toes, the CoP measured as
    they came down again took 13 cm of 17 from the rest of the step.

    ``normal``: (3,) of the sole as the other foot left the ground, a unit vector.
    ``level``: (3,) estimated normal of the ground, a unit vector.
    ``lower``, ``upper``: (2,) corners of the foothold in the sole's axes, from its middle [m].
    ``half``: (2,) half sizes of the sole [m].
    ``tipped``: (2,) tilt of the unit normal on its axes while tipping, else 0.
    """

    normal: Array
    level: Array
    lower: Array
    upper: Array
    half: Array
    tipped: Array

    @classmethod
    def whole(cls, normal: Array, level: Array, half: Array) -> Self:
        """Return all of a sole of a normal (3,) and half sizes (2,), on ground of normal (3,)."""
        return cls(normal, level, -half, half, half, np.zeros(2))

    def update(self, rotation: Rotation, wrench: Array, weight: float) -> Self:
        """Return the foothold updated by a measurement.

        ``rotation``: (3, 3) of the sole.
        ``wrench``: (6,) on it, about its middle, world axes [N, N m].
        ``weight``: of the robot [N].
        """
        # Components of the former normal: a sole that tips ahead leans back from it.
        (a, b, _), (c, d, _), (e, f, _) = rotation
        x, y, z = self.normal.tolist()
        ahead, aside = x * a + y * c + z * e, x * b + y * d + z * f
        if max(abs(ahead), abs(aside)) <= TIP_ANGLE and not any(self.tipped.tolist()):
            return self  # it stands as it stood
        R, tilt = np.array(rotation), np.array((ahead, aside))
        level = self.level.dot(R[:, :2])
        sign = np.sign(tilt)
        angle = np.minimum(sign * tilt, sign * level)
        is_tipping = angle > np.maximum(sign * self.tipped + TIP_GROWTH, TIP_ANGLE)
        has_settled = (angle < 0.5 * TIP_ANGLE) & (self.tipped != 0.0)
        force, moment = R.T @ wrench[:3], R.T @ wrench[3:]
        if force[2] < MIN_LOAD * weight or not (is_tipping | has_settled).any():
            return self
        tipped = np.where(is_tipping, sign * angle, np.where(has_settled, 0.0, self.tipped))
        cop = np.array((-moment[1], moment[0])) / force[2]
        upper = np.where(is_tipping & (sign < 0.0), cop - EDGE_MARGIN * self.half, self.upper)
        lower = np.where(is_tipping & (sign > 0.0), cop + EDGE_MARGIN * self.half, self.lower)
        # It only shrinks, and its edges do not cross.
        upper = np.clip(upper, self.lower, self.upper)
        lower = np.clip(lower, self.lower, upper)
        return self._replace(lower=lower, upper=upper, tipped=tipped)

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """Return the nearest point of the foothold, in the sole's axes [m]."""
        (left, low), (right, high) = self.lower.tolist(), self.upper.tolist()
        return min(max(x, left), right), min(max(y, low), high)
