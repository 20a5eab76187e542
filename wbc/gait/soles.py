"""The soles among a controller's contacts, and the capture point over them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from wbc.constraints import Contact, PointContact
from wbc.robot import Snapshot
from wbc.tasks import Task
from wbc.validate import Array

MIN_UPWARDS = 0.5  # z of a contact's normal: smaller, it is on a wall


class SoleContact(NamedTuple):
    """A contact, and the corners (k, 3) of its sole in its frame's axes [m]."""

    contact: Contact
    corners: Array

    @property
    def anchored(self) -> Array:
        """The corners (k, 3) where they are held, world axes [m]."""
        return self.contact.position + self.corners @ self.contact.rotation.T

    def measured(self, snapshot: Snapshot) -> Array:
        """Return the corners (k, 3) where they are, world axes [m]."""
        frame = self.contact.frame
        return snapshot.position(frame) + self.corners @ snapshot.rotation(frame).T


def standing_soles(contacts: Sequence[Task]) -> list[SoleContact]:
    """Return the contacts with corners that bear: soles and points, without those on walls."""
    return [
        SoleContact(one, one.corners)
        for one in contacts
        if isinstance(one, Contact)
        and one.corners is not None
        and (one.normal if isinstance(one, PointContact) else one.rotation[:, 2])[2] >= MIN_UPWARDS
    ]


def capture_point(snapshot: Snapshot, height: float) -> tuple[Array, float]:
    """Return xi = c + c'/omega (2,) [m] and omega [1/s], the CoM ``height`` [m] over the soles."""
    omega = math.sqrt(snapshot.robot.gravity / height)
    return snapshot.com[:2] + snapshot.com_velocity[:2] / omega, omega
