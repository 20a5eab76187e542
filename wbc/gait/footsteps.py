"""Where feet go at a velocity: from each foot to the next, and so on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wbc.gait.command import Velocity
from wbc.gait.dcm import dcm_offsets
from wbc.gait.settings import GaitSettings
from wbc.gait.swing import turned
from wbc.validate import Array

# So many steps are looked ahead; what comes later counts for exp(-omega T) per step, some 1/6.
AHEAD = 6
SIGN = {"left": 1.0, "right": -1.0}


def other(side: str) -> str:
    """Return the other foot."""
    return "right" if side == "left" else "left"


@dataclass(frozen=True)
class Footsteps:
    """The footsteps of a gait, in world axes; feet are never nearer than its width."""

    gait: GaitSettings

    def step(self, support: str, heading: float, velocity: Velocity) -> Array:
        """Return the way (2,) [m] from the foot ``support`` to the next.

        The middle between the feet moves by v T; sideways the foot that leads does all of it, so
        that the one that follows need not pass the other.

        Parameters
        ----------
        heading:
            Of the standing foot [rad].
        """
        vx, vy, yaw_rate = velocity
        T, sign = self.gait.times.total, SIGN[other(support)]
        leads = sign * vy > 0.0
        middle = _plane(heading + 0.5 * yaw_rate * T) @ (vx * T, 2.0 * vy * T if leads else 0.0)
        beside = np.array((0.0, 0.5 * sign * self.gait.width))
        return np.asarray(
            middle + _plane(heading) @ beside + _plane(heading + yaw_rate * T) @ beside
        )

    def offset(self, foot: str, heading: float, velocity: Velocity) -> Array:
        """Return where the DCM should be from a foot (2,) [m] when that alone begins to bear."""
        steps = []
        for _ in range(AHEAD):
            steps.append(self.step(foot, heading, velocity))
            foot, heading = other(foot), heading + velocity.yaw_rate * self.gait.times.total
        return dcm_offsets(steps, self.gait.times, self.gait.omega)[0]


def _plane(yaw: float) -> Array:
    return turned(yaw)[:2, :2]


def first_swing(velocity: Velocity) -> str:
    """Return the foot to begin with: the one that leads sideways or in a turn, or the right one."""
    leads = velocity.vy if velocity.vy != 0.0 else velocity.yaw_rate
    return "left" if leads > 0.0 else "right"
