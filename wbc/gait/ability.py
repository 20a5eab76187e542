"""Whether legs can walk: their joints, and the torques that it takes to bear the robot."""

from __future__ import annotations

import logging
import math

import numpy as np

from wbc.constraints.line_contact import LineContact
from wbc.constraints.mechanics import BoltedBase, mechanics_of
from wbc.constraints.sole_contacts import contact_kind, rolls
from wbc.errors import listed
from wbc.gait.legs import SIDES, knee_of
from wbc.robot import Snapshot
from wbc.robot.chains import leg_joints
from wbc.robot.limits import BASE_NV
from wbc.robot.names import BASE
from wbc.robot.notes import NOTED
from wbc.validate import Array

# Dry friction above this part of a joint's torque disturbs the swing. At a quarter a small humanoid
# with servos walks half as fast as commanded.
FRICTION_SHARE = 0.1
# Largest part of an ankle's torque that may bear the robot, the rest balances it; largest offset of
# the CoP for that, in half lengths of the sole; and smallest change of the torque with the offset
# [weight]: a roll joint's is smaller.
ANKLE_SHARE, MAX_OFFSET, MIN_SLOPE = 0.5, 0.5, 0.25


def pressure_offset(posture: Snapshot, effort: Array) -> float:
    """Return the CoP's offset ahead of the soles' middles that weak ankles need [m]; else 0.

    Behind the middle of the sole an ankle bears the robot with less torque. If the middle is asked
    of ankles that are too weak, the CoP is behind it all the same, and the robot walks faster than
    commanded: a Unitree H1 goes on at 0.15 m/s where it should stop.

    ``posture``, ``effort``: see :func:`leg_limits`.
    """
    robot, largest = posture.robot, 0.0
    for side in SIDES:
        foot, joints = robot.feet[side], leg_joints(robot, side)
        needed = bearing_torques(posture, foot.frame)
        dofs = np.array([robot.model.idx_vs[joint] for joint in joints]) - BASE_NV
        excess = np.abs(needed) - ANKLE_SHARE * effort
        if (excess[dofs] <= 0.0).all():
            continue  # finding the knee takes milliseconds
        probe = MAX_OFFSET * float(min(foot.polygon[:, 0].max(), -foot.polygon[:, 0].min()))
        slope = (bearing_torques(posture, foot.frame, probe) - needed) / probe
        for k in dofs[joints.index(knee_of(robot, side)) + 1 :]:
            if excess[k] > 0.0 and abs(slope[k]) > MIN_SLOPE * robot.weight:
                ahead = -math.copysign(float(excess[k]), needed[k]) / float(slope[k])
                largest = max(largest, min(max(ahead, -probe), probe), key=abs)
    return largest


def leg_limits(posture: Snapshot, effort: Array, dry: float, ahead: float = 0.0) -> tuple[str, ...]:
    """Return notes on what limits a robot's legs in walking, and log them as warnings.

    ``posture``: the walking posture, on both feet.
    ``effort``: (nv - 6,) torque limits [N m], infinite where there is none.
    ``dry``: part of the dry friction that is not compensated.
    ``ahead``: of the CoP from the soles' middles, see :func:`pressure_offset` [m].
    """
    robot = posture.robot
    notes = []
    stiff = [f"the {side} leg" for side in SIDES if not rolls(posture, side)]
    if stiff:
        line = any(contact_kind(posture, robot.feet[side].frame) is LineContact for side in SIDES)
        notes.append(
            f"{' and '.join(stiff)} cannot roll the sole"
            f"{', which is held along its length only (LineContact)' if line else ''}: it may stand"
            " on an edge, and the robot drift sideways"
        )
    both = [np.abs(bearing_torques(posture, robot.feet[side].frame, ahead)) for side in SIDES]
    needed = np.max(both, axis=0)
    weak = [
        f"{robot.joint_names[k]} takes {needed[k]:.3g} and has {effort[k]:.3g}"
        for k in np.flatnonzero(needed > effort).tolist()
    ]
    where = f"{1e3 * abs(ahead):.0f} mm {'behind' if ahead < 0.0 else 'ahead of'} the middle"
    if ahead:
        notes.append(
            f"the CoP's target is {where} of soles, where ankles bear the robot with less of their"
            " torque: steps resist smaller pushes there"
        )
    if weak:
        notes.append(
            f"with the CoP {where if ahead else 'at the middle'} of one sole"
            f" {', '.join(weak)} N m: the CoP will be elsewhere, so that the robot walks faster"
            " than commanded, or falls; a file may have one motor's torque where two drive a joint"
            " by rods: then give the joint's, as"
            f" effort={{{robot.joint_names[int(np.argmax(needed - effort))]!r}: ...}}"
        )
    legs = [robot.model.idx_vs[joint] for side in SIDES for joint in leg_joints(robot, side)]
    friction = dry * robot.friction
    friction[[robot.joint_index(name) - BASE_NV for name in robot.motorless]] = 0.0
    sticky = [k for k in np.subtract(legs, BASE_NV) if friction[k] > FRICTION_SHARE * effort[k]]
    if sticky:
        worst = max(float(friction[k] / effort[k]) for k in sticky)
        names = listed([robot.joint_names[k] for k in sticky])
        notes.append(
            f"dry friction takes up to {100.0 * worst:.0f} % of the torque of"
            f" {names}: without friction_compensation=1 feet lag behind, and the robot walks"
            " slower than commanded"
        )
    for note in notes:
        logging.getLogger(__name__).warning("walker: %s: %s", robot.name, note, extra=NOTED)
    return tuple(notes)


def bearing_torques(posture: Snapshot, sole: str, ahead: float = 0.0) -> Array:
    """Return the torques (nv - 6,) [N m or N] at the beginning of single support on a sole.

    The CoM is still between the feet, and the robot moves as one body without turning, as a linear
    inverted pendulum: c'' = g/h (c - p), with the CoP p at ``ahead`` of the sole's frame [m]. The
    force M (c'' + g) then goes through the CoM, so that the base's equations of motion hold. Joints
    without a motor get no torque, but for their springs': loops and gears pass it on to the motors.
    """
    robot, J, offset = posture.robot, posture.jacobian(sole), ahead * posture.rotation(sole)[:, 0]
    p = posture.position(sole) + offset
    up = -robot.model.gravity.linear
    arm = posture.com - p
    force = robot.mass * float(up[2]) / float(arm[2]) * arm  # from p through the CoM
    acceleration = np.zeros(robot.nv)
    acceleration[:3] = posture.rotation(BASE).T @ (force / robot.mass - up)
    borne = J[:3].T @ force + J[3:].T @ np.cross(offset, force)
    borne += robot.passive_forces_at(posture)
    torques = np.asarray((posture.mass_matrix @ acceleration + posture.bias - borne)[BASE_NV:])
    passive = [robot.joint_index(name) - BASE_NV for name in robot.motorless]
    ties = [tie for tie in mechanics_of(robot, ()) if not isinstance(tie, BoltedBase)]
    if not (passive and ties):
        return torques
    J = np.concatenate([tie.residual(posture).jacobian[:, BASE_NV:] for tie in ties])
    forces = np.linalg.lstsq(J[:, passive].T, torques[passive], rcond=1e-9)[0]
    torques -= J.T @ forces
    torques[passive] = 0.0
    return torques
