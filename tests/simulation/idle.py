"""Plants that nothing drives: on the ground as they stand, or high above it."""

from typing import Any

import numpy as np

from wbc.robot import Robot
from wbc.simulation import Plant
from wbc.validate import Array


def idle(plant: Plant, steps: int = 1, torque: Array | None = None) -> None:
    """Step a plant without torques, or with the same ones."""
    for _ in range(steps):
        plant.step(np.zeros(plant.robot.nv - 6) if torque is None else torque)


def in_the_air(robot: Robot, height: float = 30.0, **options: Any) -> Plant:
    """Return a plant in free fall, in the standing posture; nothing of it has a shape."""
    plant = Plant(robot, shapes=False, **options)
    q = robot.posture("standing")
    q[2] = height
    plant.reset(q)
    return plant
