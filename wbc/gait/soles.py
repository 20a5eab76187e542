"""The soles that stand, by what a controller holds, and the capture point over them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from wbc.constraints import Contact, PointContact
from wbc.robot import Snapshot
from wbc.tasks import Task
from wbc.validate import Array

UPWARDS = 0.5  # a point that faces up by less is on a wall


def anchored_soles(contacts: Sequence[Task]) -> Array | None:
    """Return the corners (n, 3) [m] of soles, world axes, where they are held; None without any.

    Points on walls are left out.
    """
    corners = [
        one.position + one.corners @ one.rotation.T
        for one in contacts
        if isinstance(one, Contact) and one.corners is not None and not _on_a_wall(one)
    ]
    return np.concatenate(corners) if corners else None


def capture_point(snapshot: Snapshot, height: float) -> tuple[Array, float]:
    """Return xi = c + c'/omega (2,) [m] and omega [1/s], the CoM ``height`` [m] over the soles."""
    omega = math.sqrt(snapshot.robot.gravity / height)
    return snapshot.com[:2] + snapshot.com_velocity[:2] / omega, omega


def _on_a_wall(contact: Contact) -> bool:
    return isinstance(contact, PointContact) and contact.normal[2] < UPWARDS
