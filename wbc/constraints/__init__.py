"""Constraints: what the robot must respect while its tasks pull at it."""

from wbc.constraints.contact import Contact, PointContact, support
from wbc.constraints.limits import Limits

__all__ = ["Contact", "Limits", "PointContact", "support"]
