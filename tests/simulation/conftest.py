"""Robots to simulate."""

import pytest

from tests.conftest import load
from wbc.robot import Robot, robot_names


@pytest.fixture(params=robot_names())
def humanoid(request: pytest.FixtureRequest) -> Robot:
    return load(request.param)
