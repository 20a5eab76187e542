"""Correspondence of a robot's frames with a human's segments, found by geometry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait.legs import SIDES, bending_joint, check_biped
from wbc.robot import Robot, Snapshot
from wbc.robot.chains import chain_to, leg_joints
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.validate import Array, by_name, read_only

MIN_ARM_OFFSET = 0.05  # of a hand to the side of the base, by the CoM's height
# Parts whose frames may be given.
ARM_PARTS = ("shoulder", "upper_arm", "forearm", "hand")
PARTS = ("pelvis", "trunk", "head", *(f"{side}_{part}" for side in SIDES for part in ARM_PARTS))


@dataclass(frozen=True, eq=False)
class RobotArm:
    """Frames of one arm; ``shoulder``, ``forearm`` and ``hand`` have their origins in the joints.

    Attributes
    ----------
    shoulder, upper_arm, forearm, hand:
        Frames; the upper arm extends from the shoulder to the forearm's origin, the forearm to the
        hand's. If the elbow is the last joint, hand and forearm are the same frame, and the forearm
        extends to the CoM of the links behind that joint.
    upper_axis, forearm_axis:
        Unit vectors (3,) along them, in the axes of the upper arm and of the forearm.
    length:
        Of upper arm and forearm together [m].
    """

    shoulder: str
    upper_arm: str
    forearm: str
    hand: str
    upper_axis: Array
    forearm_axis: Array
    length: float

    @property
    def segments(self) -> tuple[tuple[str, str, Array], ...]:
        """Name, frame and axis of upper arm and forearm."""
        upper_arm = "upper arm", self.upper_arm, self.upper_axis
        return upper_arm, ("forearm", self.forearm, self.forearm_axis)


@dataclass(frozen=True, eq=False)
class BodyMap:
    """Frames of a robot that correspond to a human's segments; made by :func:`body_map`.

    Attributes
    ----------
    pelvis, trunk, head:
        Frames; the trunk may be the pelvis, and there may be no head that moves.
    arms:
        Of the robot, by side.
    upright:
        Rotation (3, 3) of these frames in the standing posture, where a human's axes are those of
        the world: x forwards, z up.
    notes:
        Parts that the robot lacks.
    """

    pelvis: str
    trunk: str
    head: str | None
    arms: Mapping[str, RobotArm]
    upright: Mapping[str, Array]
    notes: tuple[str, ...]


def body_map(robot: Robot, links: Mapping[str, str] | None = None) -> BodyMap:
    """Return the frames of a robot that correspond to a human's pelvis, trunk, head and arms.

    The pelvis is the link that carries both legs. Arms are the chains that end farthest to the left
    and to the right of the base, legs aside, if there are two; the trunk is the link that carries
    both; the elbow is the joint that shortens its arm most; the head is the end of a chain in the
    middle that begins at the trunk.

    Parameters
    ----------
    links:
        Frames by part, for robots on which this fails: ``pelvis``, ``trunk``, ``head``,
        ``left_shoulder``, ``left_upper_arm``, ``left_forearm``, ``left_hand`` and those of the
        right arm. An arm needs all four.

    Raises
    ------
    InvalidInputError
        A robot that is no biped with two soles; an arm of which parts are missing.
    UnknownNameError
        A part or a frame that does not exist.
    """
    check_biped(robot)
    given = {} if links is None else dict(by_name("retarget, links", links))
    for part, frame in given.items():
        if part not in PARTS:
            raise UnknownNameError("part of a body", part, PARTS)
        robot.frame_id(frame)
    found, notes = _frames_by_geometry(robot), list[str]()
    for side in SIDES:
        named = [part for part in ARM_PARTS if f"{side}_{part}" in given]
        if named and len(named) < len(ARM_PARTS):
            missing = ", ".join(f"{side}_{p}" for p in ARM_PARTS if p not in named)
            raise InvalidInputError(f"retarget, links: name all of the {side} arm: {missing} too")
    found |= given
    snapshot = robot.snapshot(robot.postures[STANDING])
    arms = {}
    for side in SIDES:
        if f"{side}_hand" not in found:
            notes.append(
                f"{robot.name} has no {side} arm that could be found (arms are found in pairs): it"
                " is left out; links may name its four frames"
            )
            continue
        names = [found[f"{side}_{part}"] for part in ARM_PARTS]
        places = [snapshot.position(names[k]) for k in (0, 2, 3)]
        if names[2] == names[3]:
            places[2] = _distal_com(robot, snapshot, names[3])
        vectors = np.diff(places, axis=0)
        lengths = np.linalg.norm(vectors, axis=1)
        if lengths.min() < 1e-3:
            raise InvalidInputError(
                f"retarget, links: shoulder, forearm and hand of the {side} arm of {robot.name}"
                f" ({', '.join(names)}) must be at different places"
            )
        axes = [
            read_only(snapshot.rotation(frame).T @ vector / length)
            for frame, vector, length in zip(names[1:3], vectors, lengths, strict=True)
        ]
        shoulder, upper, forearm, hand = names
        length = float(lengths.sum())
        arms[side] = RobotArm(shoulder, upper, forearm, hand, axes[0], axes[1], length)
    head = found.get("head")
    if head is None:
        notes.append(f"{robot.name} has no head that moves: its gaze follows the trunk")
    frames = [frame for frame in (found["pelvis"], found["trunk"], head) if frame is not None]
    upright = {frame: snapshot.rotation(frame) for frame in frames}
    both = MappingProxyType(arms), MappingProxyType(upright)
    return BodyMap(found["pelvis"], found["trunk"], head, *both, tuple(notes))


def _frames_by_geometry(robot: Robot) -> dict[str, str]:
    """Return the frames of the parts that geometry identifies."""
    model, snapshot = robot.model, robot.snapshot(robot.postures[STANDING])
    names = [str(name) for name in model.names]
    legs = {joint for side in SIDES for joint in leg_joints(robot, side)}
    carriers = {int(model.parents[j]) for j in range(2, model.njoints)}
    leaves = [j for j in range(2, model.njoints) if j not in carriers]
    chains = {end: chain_to(robot, end) for end in leaves}
    ends = [end for end in leaves if legs.isdisjoint(chains[end])]
    ground = np.mean([snapshot.position(foot.frame)[2] for foot in robot.feet.values()])
    min_offset = MIN_ARM_OFFSET * float(snapshot.com[2] - ground)
    base = snapshot.position(BASE)
    at = {joint: snapshot.position(names[joint]) - base for joint in range(2, model.njoints)}

    def length(end: int) -> float:
        places = np.array([at[joint] for joint in chains[end]])
        return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())

    found = {"pelvis": BASE, "trunk": BASE}
    to_feet = [chain_to(robot, robot.frame(f.frame).parentJoint) for f in robot.feet.values()]
    carry = [joint for joint in to_feet[0] if joint in to_feet[1]]
    if carry:  # a waist between the base and the legs
        found["pelvis"] = names[carry[-1]]
    sides = dict[str, list[int]]()
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        there = [end for end in ends if sign * at[end][1] > min_offset]
        if there:  # the longest chain
            sides[side] = chains[max(there, key=length)]
    if len(sides) == len(SIDES):
        left, right = (sides[side] for side in SIDES)
        shared = [joint for joint in left if joint in right]
        if shared and min(len(left), len(right)) > len(shared) + 1:  # antennas are no arms
            found["trunk"] = names[shared[-1]]
        for side, chain in sides.items():
            arm = _without_fingers(robot, chain[len(shared) :])
            if len(arm) >= 3:
                elbow = arm.index(bending_joint(robot, arm, model.inertias[arm[-1]].lever))
                parts = (arm[max(elbow - 2, 0)], arm[elbow - 1], arm[elbow])
                hand = arm[min(elbow + 2, len(arm) - 1)]
                frames = [names[joint] for joint in (*parts, hand)]
                found |= dict(zip([f"{side}_{part}" for part in ARM_PARTS], frames, strict=True))
        middle = [
            end
            for end in ends
            if end not in (left[-1], right[-1])
            and chains[end][: len(shared)] == shared
            and len(chains[end]) > len(shared)
            and abs(at[end][1]) <= max(min_offset, 0.5 * at[left[len(shared)]][1])
            and at[end][2] > at[left[len(shared)]][2]
        ]
        if middle:
            found["head"] = names[max(middle, key=lambda end: len(chains[end]))]
    return found


def _distal_com(robot: Robot, snapshot: Snapshot, frame: str) -> Array:
    """Return the CoM (3,) of the links behind a frame's joint, up to the next joints [m]."""
    rotations, origins = snapshot.joint_placements
    joint = robot.frame(frame).parentJoint
    lever: Array = robot.model.inertias[joint].lever
    return np.asarray(origins[joint] + rotations[joint] @ lever)


def _without_fingers(robot: Robot, chain: Sequence[int]) -> list[int]:
    """Return a chain up to the first link with several joints: a palm with fingers."""
    parents = [int(p) for p in robot.model.parents]
    for number, joint in enumerate(chain):
        if parents.count(joint) > 1:
            return list(chain[: number + 1])
    return list(chain)
