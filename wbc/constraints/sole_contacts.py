"""The contact that a frame makes with the ground: a sole, a line, a point."""

from __future__ import annotations

import logging
from functools import lru_cache

import numpy as np
from scipy.linalg import null_space

from wbc.constraints.contact import Contact, PointContact
from wbc.constraints.line_contact import LineContact
from wbc.robot import Robot, Snapshot
from wbc.robot.chains import leg_joints
from wbc.robot.postures import STANDING

# Legs can roll a sole if the remaining motions turn it about its length by this at least [rad per
# rad, norm]. Singular values below NULL_SPACE_RCOND of the largest are no motion: straight knees
# let the hip lean by less than the roll needs, until they bend.
MIN_ROLL, NULL_SPACE_RCOND = 0.1, 2e-2
# A sole wider than this part of the CoM's height stays flat, and is modelled so: a small humanoid
# of 0.23 without ankle roll walks aside and falls if its soles are taken for lines.
NARROW_SOLE = 0.2


@lru_cache(maxsize=16)  # a robot does not change, and each support asks for each sole
def default_contact(robot: Robot, frame: str) -> type[Contact]:
    """Return the contact that a frame makes as a robot stands; flat soles as lines are told."""
    kind = contact_kind(robot.snapshot(robot.postures[STANDING]), frame)
    if kind is LineContact and all(len(one.polygon) > 2 for one in robot.feet.values()):
        _tell_lines(robot.name)
    return kind


@lru_cache(maxsize=64)  # said once
def _tell_lines(robot: str) -> None:
    logging.getLogger(__name__).warning(
        "support: the legs of %s cannot roll their narrow soles, which are held along their length"
        " only (LineContact); Contact.hold(...), in YAML type: fixed, holds a sole flat",
        robot,
    )


def contact_kind(posture: Snapshot, frame: str) -> type[Contact]:
    """Return the contact that a frame makes.

    A point or a line if it is the sole of such a foot, and a line, too, if its leg cannot roll the
    sole, which is narrow: flat soles of two such legs have dependent rows, and where the ground
    yields a little, huge torques (an H1 standing still: 164 N m in place of 23).

    ``posture``: standing; what a leg can do is judged there.
    """
    robot = posture.robot
    foot = next((name for name, one in robot.feet.items() if one.frame == frame), None)
    if foot is None:
        return Contact
    polygon = robot.feet[foot].polygon
    kinds: dict[int, type[Contact]] = {1: PointContact, 2: LineContact}
    if len(polygon) in kinds:
        return kinds[len(polygon)]
    height = float(posture.com[2] - posture.position(frame)[2])
    is_narrow = float(np.ptp(polygon[:, 1])) < NARROW_SOLE * height
    return LineContact if is_narrow and not rolls(posture, foot) else Contact


def rolls(posture: Snapshot, foot: str) -> bool:
    """Return whether a leg's own joints can roll its sole about its length, all else fixed.

    Legs of five joints without ankle roll hold their soles level only below the hip: in the frontal
    plane they are pendulums on a line.
    """
    robot = posture.robot
    frame = robot.feet[foot].frame
    columns = [int(robot.model.idx_vs[joint]) for joint in leg_joints(robot, foot)]
    R, J = posture.rotation(frame), posture.jacobian(frame)[:, columns].reshape(2, 3, -1)
    rows = (R.T @ J).reshape(6, -1)  # in the sole's axes
    motions = null_space(np.delete(rows, 3, axis=0), rcond=NULL_SPACE_RCOND)
    return bool(motions.size) and float(np.linalg.norm(rows[3] @ motions)) > MIN_ROLL
