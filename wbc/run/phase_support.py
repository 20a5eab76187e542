"""The support of a phase: its contacts, the feet among them, its margins."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wbc.constraints import Constraint, Contact, Limits, LineContact, PointContact
from wbc.constraints.com_support import support_polygon
from wbc.constraints.margin import SKIN, Margin
from wbc.polygon import polygon_margin
from wbc.robot import Robot, Snapshot
from wbc.validate import Array

# Largest distance of a sole's corner from the ground at touch-down [m].
SOLE_FLATNESS = 1e-3
Ground = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class PhaseSupport:
    """Contacts and margins of a phase."""

    phase: str  # the phase's name; empty in a run without phases
    contacts: tuple[Contact, ...]
    # The feet in contact, if there are no other contacts; balance is then that over their support
    # polygon.
    feet: tuple[str, ...]
    margins: tuple[Margin, ...] = ()  # the constraints that are distances
    limited: bool = False  # whether there are joint position limits
    soft: frozenset[str] = frozenset()  # frames of soft contacts
    yielding: frozenset[str] = frozenset()  # names of soft margins

    @classmethod
    def on(
        cls,
        phase: str,
        contacts: Sequence[Contact],
        constraints: Iterable[Constraint] = (),
        limits: Limits | None = None,
        is_hard: Callable[[str], bool] = lambda _: True,
    ) -> PhaseSupport:
        """Return the support of contacts, with constraints and limits.

        ``is_hard``: tells whether the contact or constraint of a name is hard.
        """
        feet = held_feet(contacts)
        margins = tuple(one for one in constraints if isinstance(one, Margin))
        return cls(
            phase,
            tuple(contacts),
            feet if len(feet) == len(contacts) else (),
            margins,
            limits is not None and bool(np.isfinite(limits.upper - limits.lower).any()),
            frozenset(one.frame for one in contacts if not is_hard(one.name)),
            frozenset(one.name for one in margins if not is_hard(one.name)),
        )

    @property
    def label(self) -> str:
        """Contacts, separated by commas: feet by name, such as ``left,right``, or frames."""
        return ",".join(_foot_of(contact) or contact.frame for contact in self.contacts)

    def margin(self, snapshot: Snapshot) -> float:
        """Return the distance of the CoM's projection inside the support polygon [m].

        This is quasi-static balance; negative outside, NaN without feet.
        """
        if not self.feet:
            return float("nan")
        return float(polygon_margin(support_polygon(snapshot, self.feet), snapshot.com[:2]))

    def clearance(self, snapshot: Snapshot) -> dict[str, tuple[float, str, str]]:
        """Return the slack of each margin, negative if violated, its row and unit, by name."""
        clearances = dict[str, tuple[float, str, str]]()
        for margin in self.margins:
            distances = margin.distances(snapshot)
            if distances.clearance.size:
                k = int(distances.clearance.argmin())
                value = float(distances.clearance[k]) + SKIN
                clearances[margin.name] = value, margin.labels(distances)[k], margin.unit
        return clearances


def held_feet(contacts: Iterable[Contact]) -> tuple[str, ...]:
    """Return the feet whose whole soles are in contact."""
    feet = (_foot_of(contact) for contact in contacts)
    return tuple(foot for foot in feet if foot is not None)


def keep_anchors(before: Iterable[Contact], now: Iterable[Contact]) -> tuple[Contact, ...]:
    """Return the contacts ``now``; continued ones keep their anchor, so that drift is corrected."""
    anchored = {_contact_key(one): one for one in before}
    return tuple(anchored.get(_contact_key(one), one) for one in now)


def _contact_key(contact: Contact) -> tuple[object, ...]:
    """Return a key that is equal for contacts of which one continues the other."""
    corners = contact.corners
    points = None if corners is None else corners.tobytes()
    laws = contact.law, contact.acceleration_law
    normal = contact.normal.tobytes() if isinstance(contact, PointContact) else None
    return type(contact), contact.frame, laws, contact.friction, points, normal


def touchdowns(before: Iterable[Contact], now: Iterable[Contact]) -> tuple[str, ...]:
    """Return the feet that are in contact now and were not before."""
    stood = held_feet(before)
    return tuple(foot for foot in held_feet(now) if foot not in stood)


def held_joints(robot: Robot, contacts: Iterable[Contact]) -> set[int]:
    """Return the joints whose bodies are fixed in position and orientation."""
    fixed = (one for one in contacts if not isinstance(one, PointContact | LineContact))
    return {carrier(robot, contact.frame) for contact in fixed}


def carrier(robot: Robot, frame: str) -> int:
    """Return the joint that carries a frame: frames of one joint move as one body."""
    return int(robot.frame(frame).parentJoint)


def off_the_ground(
    snapshot: Snapshot, foot: str, ground: Ground | None = None, flat: float = SOLE_FLATNESS
) -> str | None:
    """Return why a foot cannot bear, in words, or None if its sole is flat on the ground.

    ``ground``: height of the ground (k,) [m] at points (k, 2), world axes; None: 0 everywhere.
    ``flat``: largest distance of a sole's corner from the ground [m].
    """
    sole = snapshot.robot.feet[foot]
    R, p = snapshot.rotation(sole.frame), snapshot.position(sole.frame)
    corners = sole.polygon @ R[:, :2].T + p
    heights = corners[:, 2] if ground is None else corners[:, 2] - ground(corners[:, :2])
    worst = heights[np.argmax(np.abs(heights))]
    if abs(worst) <= flat:
        return None
    where = "above" if worst > 0.0 else "below"
    text = f"the {foot} foot does not stand: a corner of its sole is {1e3 * abs(worst):.2g} mm"
    tilt = round(1e3 * float(np.ptp(heights)), 3)
    return f"{text} {where} the ground, and from corner to corner it rises by {tilt:.2g} mm"


def _foot_of(contact: Contact) -> str | None:
    """Return the foot whose whole sole a contact holds, or None; a point contact holds a point."""
    point = isinstance(contact, PointContact)
    for name, foot in contact.robot.feet.items():
        if contact.frame in (foot.frame, foot.link) and (len(foot.polygon) == 1 or not point):
            return name
    return None
