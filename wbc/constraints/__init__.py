"""Constraints: what the robot must respect while its tasks pull at it."""

from wbc.constraints.collision import SelfCollision
from wbc.constraints.com_support import ComSupport
from wbc.constraints.contact import Contact, PointContact
from wbc.constraints.friction import FrictionCone
from wbc.constraints.independent_coordinates import IndependentCoordinates
from wbc.constraints.limits import Limits
from wbc.constraints.line_contact import LineContact
from wbc.constraints.margin import BrakingParameters, Margin
from wbc.constraints.obstacles import Obstacles
from wbc.constraints.position_box import PositionBox
from wbc.constraints.rows import Bounds, Constraint, Distances
from wbc.constraints.support_modes import support
from wbc.constraints.tilt_limit import TiltLimit

__all__ = [
    "Bounds",
    "BrakingParameters",
    "ComSupport",
    "Constraint",
    "Contact",
    "Distances",
    "FrictionCone",
    "IndependentCoordinates",
    "Limits",
    "LineContact",
    "Margin",
    "Obstacles",
    "PointContact",
    "PositionBox",
    "SelfCollision",
    "TiltLimit",
    "support",
]
