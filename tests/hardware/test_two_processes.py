"""A loop and a robot, each a process of its own, over UDP on this machine, in slow motion."""

import signal

import pytest

pytest.importorskip("mujoco")
from hardware import interrupted, walk

from wbc.hardware.worker import can_fork

SLOWER = 6.0  # so that a busy machine keeps up
DOMAIN = 41  # of ports that nothing else uses

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not can_fork(), reason="the controller has no process of its own here"),
]


def test_a_g1_stands_up_walks_is_pushed_and_sits_down() -> None:
    found = walk("udp", 3.0, SLOWER, DOMAIN)
    robot = found["robot"]
    assert found["good"] and found["reason"] == "asked to quit", found
    assert robot["farthest from its start [m]"] > 0.2 and robot["tilt"] < 0.5
    low, high = robot["lowest, highest CoM [m]"]
    assert low < 0.56 and high > 0.62  # in the crouch it begins and ends with, and standing


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_loop_that_is_killed_or_stopped_leaves_a_robot_that_brakes(number: int) -> None:
    found = interrupted("udp", number, 2.0, DOMAIN + 1)
    assert found["damping after [ms]"] is not None
    assert not found["commanded again"] and found["log"]
