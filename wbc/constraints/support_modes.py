"""Support modes: which feet or frames are held, and the contacts that they make."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence

from wbc.constraints.contact import DEFAULT_FRICTION, Contact
from wbc.constraints.friction import FrictionCone
from wbc.constraints.sole_contacts import default_contact
from wbc.errors import InvalidInputError, UnknownNameError, shown
from wbc.kinds import check_word
from wbc.robot import Robot, Snapshot
from wbc.robot.model import check_snapshot
from wbc.robot.names import BASE

SUPPORTS = ("floating", "left", "right", "double", "all")


def support(
    snapshot: Snapshot,
    mode: str | Sequence[str],
    *,
    friction: FrictionCone | None = DEFAULT_FRICTION,
) -> tuple[Contact, ...]:
    """Return the contacts of a support mode, anchored at ``snapshot`` (paper 5.2).

    Those of a robot whose base is fixed begin with its base, whatever the mode. Feet that end in
    points or lines are held as such, and narrow soles that legs cannot roll, as an H1's, along
    their length only, see :func:`~wbc.constraints.sole_contacts.contact_kind`.

    Parameters
    ----------
    mode:
        ``"floating"``, ``"left"``, ``"right"``, ``"double"``, ``"all"`` feet that the robot has, or
        a list of feet and frames to hold.
    friction:
        Of each contact, for the torque level.

    Raises
    ------
    UnknownNameError
        A mode, foot or frame that does not exist.
    InvalidInputError
        No snapshot, or no mode.
    """
    check_snapshot("support", snapshot)
    if not isinstance(mode, Iterable):
        raise InvalidInputError(f"support: expected a mode or a list of frames, got {shown(mode)}")
    robot = snapshot.robot
    frames = [  # a mode's are feet, even where a joint is called as one
        robot.feet[one].frame if isinstance(mode, str) else sole_or_frame(robot, one)
        for one in feet_of(robot, mode)
    ]
    if isinstance(mode, str) and any(snapshot.rotation(frame)[2, 2] < 0.0 for frame in frames):
        logging.getLogger(__name__).warning(
            "support: soles of %s face upwards; is the quaternion q[3:7] in the order x, y, z, w?",
            robot.name,
        )
    held = (default_contact(robot, one).hold(snapshot, one, friction=friction) for one in frames)
    return base_contact(snapshot) + tuple(held)


def base_contact(snapshot: Snapshot) -> tuple[Contact, ...]:
    """Return the contact that holds the base where it is; none if the robot's base floats."""
    return (Contact.hold(snapshot, BASE),) if snapshot.robot.fixed_base else ()


def feet_of(robot: Robot, mode: str | Sequence[str]) -> tuple[str, ...]:
    """Return the feet that a support mode stands on; what is listed as it is."""
    if not isinstance(mode, str):
        return tuple(mode)
    if mode not in SUPPORTS:
        raise UnknownNameError("support mode", mode, SUPPORTS)
    every = tuple(robot.feet) or ("all",)  # which none of its feet is called
    feet = {"floating": (), "double": ("left", "right"), "all": every}.get(mode, (mode,))
    for foot in feet:
        if robot.feet and foot not in robot.feet:
            names = ", ".join(robot.feet)
            remedy = f"its feet are {names}; write all, or a list of those to stand on"
            raise UnknownNameError(f"foot of {robot.name}", foot, robot.feet, remedy)
        robot.foot(foot)
    return feet


def sole_or_frame(robot: Robot, name: str) -> str:
    """Return the frame that a name in a list of supports means: a frame's own, or a foot's sole."""
    check_word("support, frame", name)
    if name in robot.feet and name not in robot.frame_indices:
        return robot.feet[name].frame
    return name
