"""Walking: footsteps for the capture point. Standing under pushes: its gain, hands on walls."""

from wbc.gait.arms import Arm
from wbc.gait.capture_gain import CaptureGain
from wbc.gait.command import Admitted, CommandLimits, Velocity
from wbc.gait.hand_states import LeanSettings
from wbc.gait.hand_supervisor import WithHands
from wbc.gait.hand_support import HandSupport
from wbc.gait.legs import Legs
from wbc.gait.prescribed_steps import Footstep, Landing
from wbc.gait.settings import GaitSettings
from wbc.gait.walker import Walker
from wbc.gait.walls import Hand, Wall
from wbc.gait.whole_body import WalkingWeights

__all__ = [
    "Admitted",
    "Arm",
    "CaptureGain",
    "CommandLimits",
    "Footstep",
    "GaitSettings",
    "Hand",
    "HandSupport",
    "Landing",
    "LeanSettings",
    "Legs",
    "Velocity",
    "Walker",
    "WalkingWeights",
    "Wall",
    "WithHands",
]
