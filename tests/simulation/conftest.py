"""Robots that can be simulated: iCub's file needs rotor inertia (see test_build)."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from wbc.robot import Robot, Snapshot, robot_names

NAMES = robot_names()


@cache
def loaded(name: str) -> Robot:
    robot = Robot.load(name)
    if name == "icub":
        robot.model.armature[6:] = 1e-3
    return robot


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
