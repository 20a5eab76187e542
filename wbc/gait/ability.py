"""Whether legs can walk: their joints, and the torques that bearing the robot takes."""

from __future__ import annotations

import logging
import math

import numpy as np
from scipy.linalg import null_space

from wbc.constraints.contact import Contact
from wbc.constraints.line_contact import LineContact
from wbc.constraints.mechanics import BoltedBase, mechanics_of
from wbc.constraints.support_modes import contact_kind
from wbc.errors import listed
from wbc.gait.legs import SIDES, knee_of, leg_joints
from wbc.robot import Snapshot
from wbc.robot.limits import BASE_NV
from wbc.robot.names import BASE
from wbc.validate import Array

# By how much joints turn a sole about its length at least, in rad per rad of theirs (norm), if they
# can roll it; and below which part of the strongest motion of a sole they have none: knees that are
# straight or nearly so let the hip lean by less than the sole's roll needs, until they bend.
LEAST_ROLL, NONE = 0.1, 2e-2
# A sole that is wider than this part of the CoM's height stays flat, and is led as one that does: a
# small humanoid of 0.23 without rolls walks aside, and falls, if it is taken for a line.
NARROW = 0.2
# Of a joint's torque: dry friction that takes more of it is felt in how feet are led. With a
# quarter a servo's small humanoid goes half as fast as it is told to.
STICKY = 0.1
# Part of an ankle's torque that bears the robot at most, for the rest to balance it; of a sole's
# half length by how much the pressure is moved for that, at most; and what the torque changes by
# with that way, as a part of the weight at least: that of a roll does not.
BEARS, FARTHEST, PITCHES = 0.5, 0.5, 0.25


def contact_of(posture: Snapshot, side: str) -> type[Contact]:
    """Return the contact that a foot makes in a walk: along its length if it cannot be rolled."""
    foot = posture.robot.feet[side]
    height = float(posture.com[2] - posture.position(foot.frame)[2])
    narrow = float(np.ptp(foot.polygon[:, 1])) < NARROW * height
    stiff = narrow and not rolls(posture, side)
    return LineContact if stiff else contact_kind(posture.robot, foot.frame)


def rolls(posture: Snapshot, side: str) -> bool:
    """Return whether a leg's own joints can roll its sole while the rest of it stays where it is.

    Other legs, of five joints without an ankle's roll, hold their soles level only where the hip
    is above them: seen from ahead they are pendulums on the sole's length.
    """
    robot = posture.robot
    frame = robot.feet[side].frame
    own = [int(robot.model.idx_vs[joint]) for joint in leg_joints(robot, side)]
    R, J = posture.rotation(frame), posture.jacobian(frame)[:, own].reshape(2, 3, -1)
    rows = (R.T @ J).reshape(6, -1)  # in the sole's axes
    left = null_space(np.delete(rows, 3, axis=0), rcond=NONE)
    return bool(left.size) and float(np.linalg.norm(rows[3] @ left)) > LEAST_ROLL


def pressed_ahead(posture: Snapshot, most: Array) -> float:
    """Return how far ahead of the soles' middles the pressure is best led [m]; 0 if ankles bear it.

    Behind a sole's middle an ankle bears with less. Led to the middle by ankles that cannot, the
    pressure is behind it all the same, and the robot walks faster than it is told to: a Unitree H1
    goes on ahead by 0.15 m/s where it should stop.

    Parameters
    ----------
    posture, most:
        As of :func:`lacks`.
    """
    robot, found = posture.robot, 0.0
    for side in SIDES:
        foot, joints = robot.feet[side], leg_joints(robot, side)
        needed = bearing_torques(posture, foot.frame)
        own = np.array([robot.model.idx_vs[joint] for joint in joints]) - BASE_NV
        excess = np.abs(needed) - BEARS * most
        if (excess[own] <= 0.0).all():
            continue  # no need to find out which is the knee, which takes milliseconds
        far = FARTHEST * float(min(foot.polygon[:, 0].max(), -foot.polygon[:, 0].min()))
        slope = (bearing_torques(posture, foot.frame, far) - needed) / far
        for k in own[joints.index(knee_of(robot, side)) + 1 :]:
            if excess[k] > 0.0 and abs(slope[k]) > PITCHES * robot.weight:
                ahead = -math.copysign(float(excess[k]), needed[k]) / float(slope[k])
                found = max(found, min(max(ahead, -far), far), key=abs)
    return found


def lacks(posture: Snapshot, most: Array, stuck: float, ahead: float = 0.0) -> tuple[str, ...]:
    """Return what the legs of a robot lack for walking, in words, and warn of it.

    Parameters
    ----------
    posture:
        The one that it walks in, on both feet.
    most:
        (nv - 6,) largest torques [N m], infinite where there is no limit.
    stuck:
        Part of the dry friction that is not made up for.
    ahead:
        Of the soles' middles the pressure is led [m].
    """
    robot = posture.robot
    said = []
    stiff = [f"the {side} leg" for side in SIDES if not rolls(posture, side)]
    if stiff:
        line = any(contact_of(posture, side) is LineContact for side in SIDES)
        said.append(
            f"{' and '.join(stiff)} cannot roll the sole"
            f"{', which is held along its length only (LineContact)' if line else ''}: it may stand"
            " on an edge, and the robot walk aside"
        )
    both = [np.abs(bearing_torques(posture, robot.feet[side].frame, ahead)) for side in SIDES]
    needed = np.max(both, axis=0)
    weak = [
        f"{robot.joint_names[k]} takes {needed[k]:.3g} and has {most[k]:.3g}"
        for k in np.flatnonzero(needed > most).tolist()
    ]
    where = f"{1e3 * abs(ahead):.0f} mm {'behind' if ahead < 0.0 else 'ahead of'} the middle"
    if ahead:
        said.append(
            f"the pressure is led {where} of soles, where ankles bear the robot with less of their"
            " torque: steps catch less there"
        )
    if weak:
        said.append(
            f"with the pressure {where if ahead else 'at the middle'} of one sole"
            f" {', '.join(weak)} N m: it will be"
            " elsewhere, so that the robot walks faster than it is told to, or falls; a file may"
            " have one motor's torque where two drive a joint by rods: then give the joint's, as"
            f" effort={{{robot.joint_names[int(np.argmax(needed - most))]!r}: ...}}"
        )
    legs = [robot.model.idx_vs[joint] for side in SIDES for joint in leg_joints(robot, side)]
    friction = stuck * robot.friction
    friction[[robot.joint_index(name) - BASE_NV for name in robot.motorless]] = 0.0
    sticky = [k for k in np.subtract(legs, BASE_NV) if friction[k] > STICKY * most[k]]
    if sticky:
        part = max(float(friction[k] / most[k]) for k in sticky)
        called = listed([robot.joint_names[k] for k in sticky])
        said.append(
            f"dry friction takes up to {100.0 * part:.0f} % of the torque of"
            f" {called}: without friction_compensation=1 feet lag behind, and the robot walks"
            " slower than it is told to"
        )
    for note in said:
        logging.getLogger(__name__).warning("walker: %s: %s", robot.name, note)
    return tuple(said)


def bearing_torques(posture: Snapshot, sole: str, ahead: float = 0.0) -> Array:
    """Return the torques (nv - 6,) [N m or N] at which one sole alone begins to bear in a walk.

    The CoM is where it is between the feet, and the robot moves as one body without turning, as a
    linear inverted pendulum: c'' = g/h (c - p), with the pressure p so far ``ahead`` of the sole's
    frame [m]. The force M (c'' + g) then goes through the CoM, and the base's own equations hold by
    themselves. Joints without a motor get none: what they would need goes through loops and gears
    to the motors.
    """
    robot, J, way = posture.robot, posture.jacobian(sole), ahead * posture.rotation(sole)[:, 0]
    p = posture.position(sole) + way
    up = -robot.model.gravity.linear
    arm = posture.com - p
    force = robot.mass * float(up[2]) / float(arm[2]) * arm  # along the line through p and the CoM
    rate = np.zeros(robot.nv)
    rate[:3] = posture.rotation(BASE).T @ (force / robot.mass - up)
    borne = J[:3].T @ force + J[3:].T @ np.cross(way, force)
    needed = np.asarray((posture.mass_matrix @ rate + posture.bias - borne)[BASE_NV:])
    without = [robot.joint_index(name) - BASE_NV for name in robot.motorless]
    ties = [one for one in mechanics_of(robot, ()) if not isinstance(one, BoltedBase)]
    if not (without and ties):  # a joint that swings freely takes what nothing gives
        return needed
    J = np.concatenate([one.residual(posture).jacobian[:, BASE_NV:] for one in ties])
    forces = np.linalg.lstsq(J[:, without].T, needed[without], rcond=1e-9)[0]
    needed -= J.T @ forces
    needed[without] = 0.0
    return needed
