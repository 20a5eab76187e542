"""A largest independent set of contact rows; redundant rows are left out.

Four held corners of a sole have twelve rows, of which six are independent. The other six agree with
them to first order only: the second-order drift of a tick makes the twelve contradict each other,
and the QP infeasible. Contacts that really hold one link at two places keep all their rows, so that
the tick can name them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.linalg import qr

from wbc.constraints.contact import Contact, ContactRows, PointContact
from wbc.constraints.line_contact import LineContact
from wbc.rotations import log_rotation
from wbc.spatial import skew
from wbc.tasks.task import Task
from wbc.validate import Array, Index

# Rows count as dependent below this part of the largest, positions measured in the link's size.
RANK_TOLERANCE = 1e-6
# Anchors of one link may disagree by the drift of held feet [m, rad]. A larger disagreement is a
# real contradiction.
DRIFT, ANGLE_DRIFT = 5e-3, 5e-2


def independent_rows(contacts: Sequence[Task]) -> ContactRows:
    """Return the rows of contacts, or other tasks to be met exactly, for the QP.

    Of contacts on one link a largest set of independent rows, chosen at their anchors; of all other
    tasks all rows.
    """
    selections: list[Index | None] = [None] * len(contacts)
    for members in _by_link(contacts):
        together = [contact for k in members if isinstance(contact := contacts[k], Contact)]
        if len(members) < 2 or not all(_are_consistent(a, b) for a, b in combinations(together, 2)):
            continue
        chosen = _independent(together)
        start = 0
        for k in members:
            size = len(contacts[k].rows)
            own = chosen[(chosen >= start) & (chosen < start + size)] - start
            selections[k] = None if own.size == size else own
            start += size
    return ContactRows(contacts, selections)


def _are_consistent(a: Contact, b: Contact) -> bool:
    """Return whether one link can meet both anchors, up to drift."""
    if len(a.rows) < len(b.rows):
        a, b = b, a
    here, there = (one.robot.frame(one.frame).placement for one in (a, b))
    arm, separation = there.translation - here.translation, b.position - a.position
    if isinstance(a, PointContact | LineContact):
        return abs(float(np.linalg.norm(arm) - np.linalg.norm(separation))) <= DRIFT
    link = a.rotation @ here.rotation.T
    if np.linalg.norm(link @ arm - separation) > DRIFT:
        return False
    turn = link.T @ b.rotation @ there.rotation.T
    return isinstance(b, PointContact) or float(np.linalg.norm(log_rotation(turn))) <= ANGLE_DRIFT


def _by_link(contacts: Sequence[Task]) -> list[list[int]]:
    """Return the indices of the contacts on each moving link."""
    found: dict[int, list[int]] = {}
    for k, contact in enumerate(contacts):
        if isinstance(contact, Contact):
            found.setdefault(int(contact.robot.frame(contact.frame).parentJoint), []).append(k)
    return list(found.values())


def _independent(contacts: Sequence[Contact]) -> Index:
    """Return a largest set of independent rows of contacts on one link, well conditioned.

    In the twist of the link at the first anchor a point at p moves by v + w x p.
    """
    origin = contacts[0].position
    levers = [contact.position - origin for contact in contacts]
    size = max(float(np.linalg.norm(lever)) for lever in levers)
    rows = np.concatenate(
        [
            _rows_of(contact, lever / size if size else lever)
            for contact, lever in zip(contacts, levers, strict=True)
        ]
    )
    _, triangle, order = qr(rows.T, mode="economic", pivoting=True)
    sizes = np.abs(np.diagonal(triangle))
    rank = int(np.count_nonzero(sizes > RANK_TOLERANCE * sizes[0]))
    return np.sort(order[:rank]).astype(np.int64)


def _rows_of(contact: Contact, lever: Array) -> Array:
    """Return a contact's rows (k, 6) by its link's twist; ``lever`` (3,) leads to its frame."""
    rows = np.eye(6)
    rows[:3, 3:] = -skew(lever)
    if isinstance(contact, LineContact):
        return np.concatenate((rows[:3], contact.axes_across @ rows[3:]))
    return rows[: len(contact.rows)]
