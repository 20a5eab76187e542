"""Joints on the way to a link, those of a leg, and those that follow others."""

from __future__ import annotations

from collections.abc import Iterator

from wbc.robot.formats.couplings import Coupling
from wbc.robot.limits import BASE_NV
from wbc.robot.model import Robot


def chain_to(robot: Robot, joint: int) -> list[int]:
    """Return Pinocchio's indices of the joints from the base to one, without the base's."""
    return [int(one) for one in robot.model.supports[joint] if one > 1]


def leg_joints(robot: Robot, foot: str) -> list[int]:
    """Return Pinocchio's indices of the joints that move this foot and no other one."""
    ends = {name: robot.frame(sole.frame).parentJoint for name, sole in robot.feet.items()}
    others = {joint for name, end in ends.items() if name != foot for joint in chain_to(robot, end)}
    return [joint for joint in chain_to(robot, ends[foot]) if joint not in others]


def followers(robot: Robot) -> Iterator[tuple[int, int, Coupling]]:
    """Yield the index of each mimic joint and of its driver, among the joints, and the gear."""
    for name, coupling in robot.couplings.items():
        yield (
            robot.joint_index(name) - BASE_NV,
            robot.joint_index(coupling.driver) - BASE_NV,
            coupling,
        )
