"""Controllers: from a snapshot to a command."""

from wbc.controllers.kinematic import KinematicController
from wbc.controllers.pseudo_inverse import PseudoInverseController
from wbc.controllers.tick import Tick

__all__ = ["KinematicController", "PseudoInverseController", "Tick"]
