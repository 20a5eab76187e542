"""Joints on the way to a link, and those of a leg."""

from __future__ import annotations

from wbc.robot.model import Robot


def chain_to(robot: Robot, joint: int) -> list[int]:
    """Return Pinocchio's indices of the joints from the base to one, without the base's."""
    return [int(one) for one in robot.model.supports[joint] if one > 1]


def leg_joints(robot: Robot, foot: str) -> list[int]:
    """Return Pinocchio's indices of the joints that move this foot and no other one."""
    ends = {name: robot.frame(sole.frame).parentJoint for name, sole in robot.feet.items()}
    others = {joint for name, end in ends.items() if name != foot for joint in chain_to(robot, end)}
    return [joint for joint in chain_to(robot, ends[foot]) if joint not in others]
