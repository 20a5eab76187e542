"""Fixtures of the controllers' tests."""

import pytest

from tests.conftest import ROBOTS, load
from wbc.native import VARIABLE
from wbc.robot import Robot


@pytest.fixture
def native(monkeypatch):
    """Return robots in the native core."""
    monkeypatch.setenv(VARIABLE, "require")
    return lambda name: Robot.load(name if name in ROBOTS[:-1] else load(name).path)
