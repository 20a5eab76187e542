"""Constraints: what the robot must respect while its tasks pull at it."""

from wbc.constraints.collision import SelfCollision
from wbc.constraints.com_support import ComSupport
from wbc.constraints.contact import Contact, PointContact, support
from wbc.constraints.limits import Limits
from wbc.constraints.margin import BrakingParameters
from wbc.constraints.obstacles import Obstacles
from wbc.constraints.position_box import PositionBox
from wbc.constraints.rows import Constraint

__all__ = [
    "BrakingParameters",
    "ComSupport",
    "Constraint",
    "Contact",
    "Limits",
    "Obstacles",
    "PointContact",
    "PositionBox",
    "SelfCollision",
    "support",
]
