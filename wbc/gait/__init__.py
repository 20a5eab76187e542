"""Walking: footsteps from a velocity, adapted to the capture point that is measured."""

from wbc.gait.command import Admitted, CommandLimits, Velocity
from wbc.gait.legs import Legs
from wbc.gait.prescribed_steps import Footstep, Landing
from wbc.gait.settings import GaitSettings
from wbc.gait.walker import Walker
from wbc.gait.whole_body import WalkingWeights

__all__ = [
    "Admitted",
    "CommandLimits",
    "Footstep",
    "GaitSettings",
    "Landing",
    "Legs",
    "Velocity",
    "Walker",
    "WalkingWeights",
]
