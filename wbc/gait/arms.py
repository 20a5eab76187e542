"""A robot's arm: how far it reaches, how fast and how strongly it moves its hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wbc.constraints import Limits
from wbc.errors import InvalidInputError
from wbc.gait.legs import MAX_ACCELERATION, SHARE, SPEED_SHARE, STRETCH
from wbc.robot.limits import BASE_NV
from wbc.robot.model import Robot, check_robot
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.validate import Array, read_only

# Largest mass of an arm with its hand, as a ratio of the robot's; the subtree of a trunk has more.
ARM_MASS_SHARE = 0.25
# Fewest joints of an arm that reaches.
MIN_JOINTS = 3
# Number of joints that count as the shoulder: those that move the hand farthest.
SHOULDER_JOINTS = 2
# Shortest arm [m]; a hand nearer than this to its last joint points as the link before it does.
MIN_LENGTH = 0.02


@dataclass(frozen=True, eq=False)
class Arm:
    """Size and abilities of one arm, in the standing posture.

    Attributes
    ----------
    hand:
        Frame of the hand.
    shoulder:
        Frame of the arm's first joint, which moves with the trunk.
    trunk:
        Link that carries it.
    forearm:
        Pinocchio's indices of the joints from the elbow on, the joint nearest to mid-length.
    length:
        Largest distance of the hand from the shoulder [m].
    pointing:
        Direction of the hand (3,), from the joint before it, in its frame's axes.
    speed, acceleration:
        At which the shoulder moves the hand [m/s, m/s^2].
    """

    hand: str
    shoulder: str
    trunk: str
    forearm: tuple[int, ...]
    length: float
    pointing: Array
    speed: float
    acceleration: float

    @classmethod
    def of(
        cls, robot: Robot, frame: str, torques: Array | None = None, within: Limits | None = None
    ) -> Arm:
        """Return the arm that ends in a frame.

        Parameters
        ----------
        torques:
            Largest torques (nv - 6,) that a controller gives [N m]; None: the effort limits.
        within:
            Limits of the joints' speeds, besides the robot's own.

        Raises
        ------
        UnknownNameError
            No such frame.
        InvalidInputError
            Fewer than three joints move it without moving the trunk, or it is at its shoulder, or
            on a leg; or its shoulder has no motors.
        """
        check_robot("arm, robot", robot)
        model = robot.model
        joints = arm_joints(robot, frame)
        if len(joints) < MIN_JOINTS:
            raise InvalidInputError(
                f"hand {frame!r}: {len(joints)} joints of {robot.name} move it without the trunk;"
                f" to reach for a wall takes {MIN_JOINTS}: name a frame at the end of an arm"
            )
        _check_not_on_leg(robot, frame)
        s = robot.snapshot(robot.postures[STANDING])
        places = [np.array(model.jointPlacements[joint].translation) for joint in joints[1:]]
        places.append(np.array(robot.frame(frame).placement.translation))
        columns = [int(model.idx_vs[joint]) for joint in joints]
        J, limits = s.jacobian(frame)[:3], robot.limits
        distances = np.cumsum([np.linalg.norm(place) for place in places])
        length = float(distances[-1])
        if length < MIN_LENGTH:
            raise InvalidInputError(
                f"hand {frame!r}: is {1e3 * length:.0f} mm from {model.names[joints[0]]}; name a"
                " frame at the end of an arm"
            )
        elbow = int(np.abs(distances[:-1] - 0.5 * length).argmin()) + 1
        levers = np.linalg.norm(J[:, columns], axis=0)
        strongest = np.argsort(levers)[-SHOULDER_JOINTS:]
        dofs = [columns[k] for k in strongest]
        inertia = s.mass_matrix.diagonal()[dofs]
        motors = [k - BASE_NV for k in dofs]
        effort = limits.effort if torques is None else torques
        fastest = limits.velocity if within is None else np.fmin(limits.velocity, within.speed)
        speed = SPEED_SHARE * (fastest[motors] * levers[strongest]).min()
        acceleration = SHARE * (effort[motors] / inertia * levers[strongest]).min()
        joint_names = [robot.limits.names[k] for k in motors]
        if not (speed > 0.0 and acceleration > 0.0) or set(joint_names) & set(robot.unactuated):
            raise InvalidInputError(
                f"hand {frame!r}: {' and '.join(joint_names)}, which move it farthest, need motors,"
                " with velocity and effort limits above 0; name a frame at the end of an arm that"
                " can reach"
            )
        parent = int(model.parents[joints[0]])
        return cls(
            hand=frame,
            shoulder=str(model.names[joints[0]]),
            trunk=link_of(robot, parent),
            forearm=tuple(joints[elbow:]),
            length=STRETCH * length,
            pointing=_pointing_axis(s.rotation(frame), s.position(frame), [
                s.position(str(model.names[joint])) for joint in reversed(joints)
            ]),
            speed=float(speed),
            acceleration=min(float(acceleration), MAX_ACCELERATION),
        )  # fmt: skip


def arm_joints(robot: Robot, frame: str) -> list[int]:
    """Return Pinocchio's indices of the joints that move a frame and not the trunk, in order."""
    model = robot.model
    joint, joints = int(robot.frame(frame).parentJoint), list[int]()
    while joint > 1:
        mass = sum(float(model.inertias[k].mass) for k in model.subtrees[joint])
        if mass > ARM_MASS_SHARE * robot.mass:
            break
        joints.insert(0, joint)
        joint = int(model.parents[joint])
    return joints


def _pointing_axis(R: Array, position: Array, origins: Sequence[Array]) -> Array:
    """Return the unit vector (3,), in axes R (3, 3), from the nearest joint that is apart."""
    direction = next(
        (position - origin for origin in origins if np.linalg.norm(position - origin) > MIN_LENGTH),
        position - origins[-1],
    )
    return read_only(R.T @ (direction / np.linalg.norm(direction)))


def _check_not_on_leg(robot: Robot, frame: str) -> None:
    """Refuse a frame on a leg, such as a sole."""
    supports, hand_joint = robot.model.supports, int(robot.frame(frame).parentJoint)
    for name, foot in robot.feet.items():
        foot_joint = int(robot.frame(foot.frame).parentJoint)
        if hand_joint in supports[foot_joint] or foot_joint in supports[hand_joint]:
            raise InvalidInputError(
                f"hand {frame!r}: is on the leg of {robot.name}'s foot {name!r}; name a frame at"
                " the end of an arm"
            )


def link_of(robot: Robot, joint: int) -> str:
    """Return a link that a joint carries, or one of the nearest joint before it that has any."""
    model = robot.model
    while joint > 1:
        for frame in model.frames:
            if int(frame.parentJoint) == joint and "BODY" in str(frame.type):
                return str(frame.name)
        joint = int(model.parents[joint])
    return BASE
