"""Robots: descriptions, limits, feet, and everything known at one state.

The only folder that knows Pinocchio.
"""

from wbc.robot.feet import Foot, FootSpec
from wbc.robot.formats.couplings import Loop
from wbc.robot.library import robot_names
from wbc.robot.limits import JointLimits
from wbc.robot.model import Robot, Snapshot
from wbc.robot.payload import Payload

__all__ = ["Foot", "FootSpec", "JointLimits", "Loop", "Payload", "Robot", "Snapshot", "robot_names"]
