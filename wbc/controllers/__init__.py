"""Controllers: from a snapshot to a command."""

from wbc.controllers.controller import Controller
from wbc.controllers.kinematic import KinematicController
from wbc.controllers.saved_tick import Replay, SavedTick
from wbc.controllers.stance import Stance, stance_torques
from wbc.controllers.tick import Tick
from wbc.controllers.torque import TorqueController
from wbc.controllers.torque_tick import TorqueTick

__all__ = [
    "Controller",
    "KinematicController",
    "Replay",
    "SavedTick",
    "Stance",
    "Tick",
    "TorqueController",
    "TorqueTick",
    "stance_torques",
]
