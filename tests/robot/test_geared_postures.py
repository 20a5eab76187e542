"""Postures of robots with mimic joints: what is named is met by both, or refused."""

import numpy as np
import pytest

from tests.robot.test_names import JOINT, LINK
from wbc.errors import InvalidInputError
from wbc.robot import Robot

GEAR = '<mimic joint="j1" multiplier="-2" offset="0.1"/></joint>'


@pytest.fixture(scope="module")
def robot() -> Robot:
    links = "".join(LINK.format(name) for name in ("trunk", "upper", "lower", "tip"))
    joints = JOINT.format("j1", "trunk", "upper") + JOINT.format("j3", "lower", "tip")
    joints += JOINT.format("j2", "upper", "lower").replace("</joint>", GEAR)
    return Robot.load(f'<robot name="geared">{links}{joints}</robot>')


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ({"j1": 0.3}, [0.3, -0.5, 0.0]),
        ({"j2": 0.3}, [-0.1, 0.3, 0.0]),  # before, 0.3 was dropped without a word
        ({"j1": 0.3, "j2": -0.5}, [0.3, -0.5, 0.0]),
        ({"j*": 0.2}, [0.2, -0.3, 0.2]),
        ({"j3": 0.5}, [0.0, 0.1, 0.5]),
    ],
)
def test_named_joint_of_a_gear_moves_the_other(
    robot: Robot, given: dict[str, float], found: list[float]
) -> None:
    np.testing.assert_allclose(robot.posture("neutral", given)[7:], found, atol=1e-9)


@pytest.mark.parametrize("given", [{"j1": 0.9}, {"j1": 0.3, "j2": 0.5}])
def test_gear_that_cannot_be_met_is_refused_by_name(robot: Robot, given: dict[str, float]) -> None:
    """At 0.9 the follower would have to be at -1.7, beyond its limit."""
    with pytest.raises(InvalidInputError, match="'j2' cannot follow 'j1' to -"):
        robot.posture("neutral", given)
