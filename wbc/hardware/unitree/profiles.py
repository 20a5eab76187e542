"""Unitree's robots by table: message family, motor of each joint, gains, modes.

Motor numbers are those of the public examples of unitree_sdk2. Gains are ours: stiff enough to hold
a posture on two feet in the simulator process; begin on the real robot, on its gantry, with less.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError, listed
from wbc.estimation import ImuMount
from wbc.kinds import one_of
from wbc.robot import Robot
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.validate import Array

PITCH_ROLL = 0  # ankles and waist are commanded by pitch and roll, not by their two motors


@dataclass(frozen=True)
class Profile:
    """Properties of a robot that are not in its model."""

    name: str  # of the option --robot
    family: str  # of its messages: hg or go
    model: str  # the robot model that this was written for
    motors: Mapping[str, int]  # number of the motor by a joint's name
    # kp [N m/rad] and kd [N m s/rad] by pattern of joints' names, for holding postures: the last
    # matching pattern counts
    stiffness: Mapping[str, float]
    holding: Mapping[str, float]
    damping: Mapping[str, float]  # kd [N m s/rad] by pattern, for braking
    # kd [N m s/rad] by pattern, while a controller commands torques and velocities
    following: Mapping[str, float]
    # of the messages of hg: whether ankles are commanded by pitch and roll (0)
    mode_pr: int = PITCH_ROLL
    imu: str = BASE  # frame of the IMU whose readings come, with its axes

    def mount(self, robot: Robot) -> ImuMount:
        """Return the mount of the IMU; at the base if the robot's model lacks its frame."""
        return ImuMount(frame=self.imu if self.imu in robot.frame_indices else BASE)

    def up(self, robot: Robot) -> tuple[float, float, float]:
        """Return the axis (3,) of the IMU that is vertical when the robot stands."""
        standing = robot.snapshot(robot.postures[STANDING])
        x, y, z = standing.rotation(self.mount(robot).frame)[2].tolist()
        return x, y, z

    def order(self, robot: Robot) -> NDArray[np.int64]:
        """Return the number of the motor of each joint (nv-6,).

        Raises
        ------
        InvalidInputError
            Joints without a motor, or several with the same.
        """
        names = robot.joint_names
        without = [name for name in names if name not in self.motors]
        if without:
            raise InvalidInputError(
                f"{self.name}: no motor for joint {listed(without)} of {robot.name}; lock them, or"
                f" take its model {self.model!r}"
            )
        order = [self.motors[name] for name in names]
        shared = [name for name, motor in zip(names, order, strict=True) if order.count(motor) > 1]
        if shared:
            raise InvalidInputError(f"{self.name}: one motor for joints {listed(shared)}")
        return np.array(order, dtype=np.int64)


def by_pattern(robot: Robot, table: Mapping[str, float]) -> Array:
    """Return a value for each joint (nv-6,): that of the last pattern that matches its name."""
    values = np.full(len(robot.joint_names), np.nan)
    for pattern, value in table.items():
        values[[fnmatchcase(name, pattern) for name in robot.joint_names]] = value
    if np.isnan(values).any():
        missing = [n for n, v in zip(robot.joint_names, values, strict=True) if np.isnan(v)]
        raise InvalidInputError(f"no gain for joint {listed(missing)}; add the pattern '*'")
    return values


def _numbered(*names: str) -> Mapping[str, int]:
    return MappingProxyType({f"{name}_joint": k for k, name in enumerate(names)})


def _sides(*names: str) -> tuple[str, ...]:
    return tuple(f"{side}_{name}" for side in ("left", "right") for name in names)


_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
_WRIST = ("wrist_roll", "wrist_pitch", "wrist_yaw")
_WAIST = ("waist_yaw", "waist_roll", "waist_pitch")
_G1_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_H1_2_LEG = ("hip_yaw", "hip_pitch", "hip_roll", "knee", "ankle_pitch", "ankle_roll")
_GO_LEGS = ("FR", "FL", "RR", "RL")

_HUMANOID: Mapping[str, Any] = {
    "stiffness": {"*": 40.0, "*hip*": 200.0, "*knee*": 300.0, "*ankle*": 120.0, "*waist*": 200.0},
    "holding": {"*": 1.0, "*hip*": 5.0, "*knee*": 6.0, "*ankle*": 3.0, "*waist*": 5.0},
    "damping": {"*": 1.0, "*hip*": 5.0, "*knee*": 5.0, "*ankle*": 2.0, "*waist*": 5.0},
    "following": {"*": 0.5, "*hip*": 1.0, "*knee*": 1.0, "*wrist*": 0.2},
}
PROFILES: Mapping[str, Profile] = {
    "unitree_g1": Profile(
        "unitree_g1",
        "hg",
        "g1",
        _numbered(*_sides(*_G1_LEG), *_WAIST, *_sides(*_ARM, *_WRIST)),
        imu="imu_in_pelvis",
        **_HUMANOID,
    ),
    "unitree_h1_2": Profile(
        "unitree_h1_2",
        "hg",
        "h1_2",
        _numbered(*_sides(*_H1_2_LEG), "torso", *_sides(*_ARM, *_WRIST)),
        **_HUMANOID,
    ),
    "unitree_go2": Profile(
        "unitree_go2",
        "go",
        "go2",
        _numbered(*(f"{leg}_{joint}" for leg in _GO_LEGS for joint in ("hip", "thigh", "calf"))),
        stiffness={"*": 60.0},
        holding={"*": 5.0},
        damping={"*": 3.0},
        following={"*": 0.5},
    ),
}
"""By the name of the option ``--robot``."""


def profile_named(name: str) -> Profile:
    """Return a robot's profile.

    Raises
    ------
    UnknownNameError
        None of that name.
    """
    return PROFILES[one_of("robot on a bus", name, list(PROFILES))]
