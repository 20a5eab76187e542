"""What counts as a fall: a lifted foot that comes down."""

import pytest

from wbc.errors import UnknownNameError
from wbc.robot import Robot
from wbc.simulation import FallLimits, Plant
from wbc.simulation.falling import FallWatch


@pytest.fixture
def plant() -> Plant:
    return Plant(Robot.load("hoap2_like"))


def test_a_lifted_foot_that_touches_the_ground_is_a_fall(plant: Plant) -> None:
    q, _ = plant.state()
    q[2] += 5e-3
    plant.reset(q)
    standing, on_one = (FallWatch(plant, FallLimits(lifted=foot)) for foot in ("", "right"))
    assert standing.verdict().stood and on_one.verdict().stood
    plant.step(plant.torque, 0.05)  # it falls by 5 mm in 32 ms
    assert standing.verdict().stood
    verdict = on_one.verdict()
    assert not verdict.stood
    assert verdict.reason.endswith("the right foot, which was lifted, touched the ground")


def test_the_lifted_foot_must_exist(plant: Plant) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'right'"):
        FallWatch(plant, FallLimits(lifted="rihgt"))
