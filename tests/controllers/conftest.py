"""Fixtures of the controllers' tests."""

import pytest

from tests.conftest import ROBOTS, load
from wbc.robot import Robot


@pytest.fixture
def native():
    """Return what loads robots anew."""
    return lambda name: Robot.load(name if name in ROBOTS[:-1] else load(name).path)


@pytest.fixture
def geared(tmp_path) -> Robot:
    """Return a robot with its base bolted and a joint that follows another one."""
    model = load("mixed_joints").path.read_text()
    mimic = '<mimic joint="hip" multiplier="0.5" offset="0.01"/>'
    place = model.index(">", model.index('<joint name="piston"')) + 1
    path = tmp_path / "geared.urdf"
    path.write_text(model[:place] + mimic + model[place:])
    return Robot.load(path, base="fixed")
