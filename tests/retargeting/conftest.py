"""A step that a robot follows, once for all tests."""

import pytest

import wbc
from tests.retargeting.humans import stepping
from wbc.robot import Robot


@pytest.fixture(scope="session")
def step() -> wbc.Retargeted:
    return wbc.retarget(stepping(), Robot.load("hoap2_like"))
