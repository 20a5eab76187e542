"""Robots to simulate, and their states."""

from collections.abc import Callable
from functools import cache

import mujoco
import numpy as np
import pytest

from tests.simulation.accelerations import acceleration_to_mujoco, velocity_map
from wbc.robot import Robot, Snapshot, robot_names
from wbc.simulation import Plant

NAMES = robot_names()


@cache
def loaded(name: str) -> Robot:
    return Robot.load(name)


@pytest.fixture(params=NAMES)
def humanoid(request: pytest.FixtureRequest) -> Robot:
    return loaded(request.param)


@pytest.fixture
def load() -> Callable[[str], Robot]:
    return loaded


@pytest.fixture
def random_state(
    random_snapshot: Callable[[Robot, np.random.Generator], Snapshot],
) -> Callable[[Robot, np.random.Generator], tuple[np.ndarray, np.ndarray]]:
    def state(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        s = random_snapshot(robot, rng)
        return s.q.copy(), s.v.copy()

    return state


@pytest.fixture
def mixed(robot_named: Callable[[str], Robot]) -> Robot:
    """A robot of every joint type, without feet and collision shapes."""
    return robot_named("mixed_joints")


@pytest.fixture
def mass_and_bias() -> Callable[[Plant, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """MuJoCo's mass matrix and bias at its present state (q, v), in the robot's coordinates."""

    def found(plant: Plant, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        M, columns = np.zeros((plant.model.nv, plant.model.nv)), np.eye(plant.model.nv)
        for k, column in enumerate(columns):
            mujoco.mj_mulM(plant.model, plant.data, M[k], column)
        # inverse dynamics of the acceleration that is zero in the robot's terms
        qacc = acceleration_to_mujoco(plant.states, q, v, np.zeros(plant.robot.nv))
        T = velocity_map(plant.states, q)
        return T.T @ M @ T, T.T @ (M @ qacc + plant.data.qfrc_bias)

    return found
