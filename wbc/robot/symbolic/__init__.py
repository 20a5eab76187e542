"""The robot as CasADi expressions: what optimisers over configurations differentiate.

The PyPI build of Pinocchio has no CasADi scalar, so the chain is built from the model's own joint
placements, axes and inertias; Pinocchio itself is the tests' oracle.
"""

from wbc.robot.symbolic.chain import LocalRobot, angle_turns, configuration_turns
from wbc.robot.symbolic.placement import Placement, from_mrp, from_quaternion, rotation_log
from wbc.robot.symbolic.posture import Expression, SymbolicPosture, posture_functions

__all__ = [
    "Expression",
    "LocalRobot",
    "Placement",
    "SymbolicPosture",
    "angle_turns",
    "configuration_turns",
    "from_mrp",
    "from_quaternion",
    "posture_functions",
    "rotation_log",
]
