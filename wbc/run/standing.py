"""What the robot stands on: held frames, the feet among them, and how well it stands there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wbc.constraints import Contact, PointContact
from wbc.constraints.com_support import support_polygon
from wbc.polygon import polygon_margin
from wbc.robot import Robot, Snapshot

# How far a corner of the sole of a foot that is put down may be from the ground [m].
FLAT = 1e-3


@dataclass(frozen=True, eq=False)
class Standing:
    """What is held in a phase.

    Attributes
    ----------
    phase:
        The phase's name; empty in a run without phases.
    contacts:
        What is held.
    feet:
        The feet that stand, if nothing else is held; what then keeps the robot from falling is the
        polygon of their soles.
    """

    phase: str
    contacts: tuple[Contact, ...]
    feet: tuple[str, ...]

    @classmethod
    def on(cls, phase: str, contacts: Sequence[Contact]) -> Standing:
        """Return what it is to stand on ``contacts``."""
        feet = held_feet(contacts)
        return cls(phase, tuple(contacts), feet if len(feet) == len(contacts) else ())

    @property
    def label(self) -> str:
        """What is held, with commas between: feet by name, such as ``left,right``, or frames."""
        return ",".join(_foot_of(contact) or contact.frame for contact in self.contacts)

    def margin(self, snapshot: Snapshot) -> float:
        """Return how far the CoM's projection is inside the soles' polygon [m]; NaN without feet.

        This is the balance of a robot that moves slowly; negative is outside.
        """
        if not self.feet:
            return float("nan")
        return float(polygon_margin(support_polygon(snapshot, self.feet), snapshot.com[:2]))


def held_feet(contacts: Iterable[Contact]) -> tuple[str, ...]:
    """Return the feet that are held as a whole."""
    feet = (_foot_of(contact) for contact in contacts)
    return tuple(foot for foot in feet if foot is not None)


def keep_anchors(before: Iterable[Contact], now: Iterable[Contact]) -> tuple[Contact, ...]:
    """Return the contacts ``now``; those that go on keep their anchor, so that no drift adds up."""
    kept = {(type(one), one.frame, one.gain): one for one in before}
    return tuple(kept.get((type(one), one.frame, one.gain), one) for one in now)


def touchdowns(before: Iterable[Contact], now: Iterable[Contact]) -> tuple[str, ...]:
    """Return the feet that stand now and did not before."""
    stood = held_feet(before)
    return tuple(foot for foot in held_feet(now) if foot not in stood)


def held_joints(robot: Robot, contacts: Iterable[Contact]) -> set[int]:
    """Return the joints whose bodies are held in position and orientation."""
    fixed = (one for one in contacts if not isinstance(one, PointContact))
    return {carrier(robot, contact.frame) for contact in fixed}


def carrier(robot: Robot, frame: str) -> int:
    """Return the joint that carries a frame: frames of one joint move as one body."""
    return int(robot.model.frames[robot.frame_id(frame)].parentJoint)


def off_the_ground(snapshot: Snapshot, foot: str) -> str | None:
    """Return in words why a foot cannot be stood on, or None if its sole is flat on the ground."""
    sole = snapshot.robot.feet[foot]
    R, p = snapshot.rotation(sole.frame), snapshot.position(sole.frame)
    heights = sole.polygon @ R[2, :2] + p[2]  # of the corners
    worst = heights[np.argmax(np.abs(heights))]
    if abs(worst) <= FLAT:
        return None
    where = "above" if worst > 0.0 else "below"
    text = f"the {foot} foot does not stand: a corner of its sole is {1e3 * abs(worst):.2g} mm"
    tilt = 1e3 * float(np.ptp(heights))
    return f"{text} {where} the ground, and from corner to corner it rises by {tilt:.2g} mm"


def _foot_of(contact: Contact) -> str | None:
    """Return the foot that a contact holds as a whole, or None."""
    if isinstance(contact, PointContact):
        return None
    feet = contact.robot.feet.items()
    return next((name for name, foot in feet if contact.frame in (foot.frame, foot.link)), None)
