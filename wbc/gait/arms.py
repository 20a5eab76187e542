"""What a robot's arm can do: how far it reaches, how fast and how strongly it moves its hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wbc.errors import InvalidInputError
from wbc.gait.legs import QUICKEST, SHARE, SPEED_SHARE, STRETCH
from wbc.robot.limits import BASE_NV
from wbc.robot.model import Robot, check_robot
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.validate import Array, read_only

# An arm with its hand is less than this part of the robot's mass, the trunk that it is on more.
HEAVIEST = 0.25
# A reach takes so many joints.
LEAST_JOINTS = 3
# Of an arm those that move the hand farthest; the weaker of them says how fast it gets there.
SHOULDER_JOINTS = 2
# A hand nearer to its last joint than this [m] points as the link before it does; and no arm is
# shorter.
POINTING = 0.02


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
        Pinocchio's indices of the joints from the elbow on: the one in the middle of its length.
    length:
        Largest distance of the hand from the shoulder to count on [m].
    pointing:
        Where the hand points (3,), from the joint behind it, in its frame's axes.
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
    def of(cls, robot: Robot, frame: str) -> Arm:
        """Return the arm that ends in a frame.

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
        if len(joints) < LEAST_JOINTS:
            raise InvalidInputError(
                f"hand {frame!r}: {len(joints)} joints of {robot.name} move it without the trunk;"
                f" to reach for a wall takes {LEAST_JOINTS}: name a frame at the end of an arm"
            )
        _check_no_leg(robot, frame)
        s = robot.snapshot(robot.postures[STANDING])
        places = [np.array(model.jointPlacements[joint].translation) for joint in joints[1:]]
        places.append(np.array(robot.frame(frame).placement.translation))
        columns = [int(model.idx_vs[joint]) for joint in joints]
        J, limits = s.jacobian(frame)[:3], robot.limits
        ways = np.cumsum([np.linalg.norm(place) for place in places])
        length = float(ways[-1])
        if length < POINTING:
            raise InvalidInputError(
                f"hand {frame!r}: is {1e3 * length:.0f} mm from {model.names[joints[0]]}; name a"
                " frame at the end of an arm"
            )
        elbow = int(np.abs(ways[:-1] - 0.5 * length).argmin()) + 1
        levers = np.linalg.norm(J[:, columns], axis=0)
        strong = np.argsort(levers)[-SHOULDER_JOINTS:]
        own = [columns[k] for k in strong]
        inertia = s.mass_matrix.diagonal()[own]
        motors = [k - BASE_NV for k in own]
        speed = SPEED_SHARE * (limits.velocity[motors] * levers[strong]).min()
        force = SHARE * (limits.effort[motors] / inertia * levers[strong]).min()
        names = [robot.limits.names[k] for k in motors]
        if not (speed > 0.0 and force > 0.0) or set(names) & set(robot.unactuated):
            raise InvalidInputError(
                f"hand {frame!r}: {' and '.join(names)}, which move it farthest, need motors, with"
                " velocity and effort limits above 0; name a frame at the end of an arm that can"
                " reach"
            )
        parent = int(model.parents[joints[0]])
        return cls(
            hand=frame,
            shoulder=str(model.names[joints[0]]),
            trunk=_link_of(robot, parent),
            forearm=tuple(joints[elbow:]),
            length=STRETCH * length,
            pointing=_pointing(s.rotation(frame), s.position(frame), [
                s.position(str(model.names[joint])) for joint in reversed(joints)
            ]),
            speed=float(speed),
            acceleration=min(float(force), QUICKEST),
        )  # fmt: skip


def arm_joints(robot: Robot, frame: str) -> list[int]:
    """Return Pinocchio's indices of the joints that move a frame and not the trunk, in order."""
    model = robot.model
    joint, joints = int(robot.frame(frame).parentJoint), list[int]()
    while joint > 1:
        mass = sum(float(model.inertias[k].mass) for k in model.subtrees[joint])
        if mass > HEAVIEST * robot.mass:
            break
        joints.insert(0, joint)
        joint = int(model.parents[joint])
    return joints


def _pointing(R: Array, place: Array, behind: Sequence[Array]) -> Array:
    """Return the unit vector (3,), in the axes R (3, 3), from the first joint that is not there."""
    way = next(
        (place - one for one in behind if np.linalg.norm(place - one) > POINTING),
        place - behind[-1],
    )
    return read_only(R.T @ (way / np.linalg.norm(way)))


def _check_no_leg(robot: Robot, frame: str) -> None:
    """Refuse a frame on a leg, such as a sole."""
    supports, own = robot.model.supports, int(robot.frame(frame).parentJoint)
    for name, foot in robot.feet.items():
        last = int(robot.frame(foot.frame).parentJoint)
        if own in supports[last] or last in supports[own]:
            raise InvalidInputError(
                f"hand {frame!r}: is on the leg of {robot.name}'s foot {name!r}; name a frame at"
                " the end of an arm"
            )


def _link_of(robot: Robot, joint: int) -> str:
    """Return a link that a joint carries, or the next before it that carries one."""
    model = robot.model
    while joint > 1:
        for frame in model.frames:
            if int(frame.parentJoint) == joint and "BODY" in str(frame.type):
                return str(frame.name)
        joint = int(model.parents[joint])
    return BASE
