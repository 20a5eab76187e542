"""States predicted over a known delay: exact where the model is, and worth it in a loop."""

from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

import wbc
from wbc.controllers.prediction import StatePrediction
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.validate import Array

Load = Callable[[str], Robot]
DT = 0.002


def moved(robot: Robot, q: Array, v: Array, a: Array, time: float) -> tuple[Array, Array]:
    """The motion at a constant acceleration, by the law that predictions are integrated by."""
    later = v + time * a
    return robot.integrate(q, 0.5 * (v + later), time), later


@pytest.mark.parametrize("delay", [DT, 2 * DT, 3 * DT, 1.5 * DT, 0.4 * DT])
def test_a_prediction_is_the_motion_by_what_was_commanded(delay: float, robot_named: Load) -> None:
    """Whole ticks and parts of one: the state at the delay's end, to rounding."""
    robot, rng = robot_named("hoap2_like"), np.random.default_rng(5)
    accelerations = rng.normal(size=(6, robot.nv))
    prediction = StatePrediction(robot, delay, DT)
    for acceleration in accelerations:
        prediction.commanded(acceleration)
    q, v = robot.posture("standing"), 0.1 * rng.normal(size=robot.nv)
    here = robot.snapshot(q, v)
    ahead = prediction.ahead(here)
    assert prediction.ahead(here) is ahead  # asked again in a tick
    whole = int(np.ceil(delay / DT - 1e-9))
    times = [delay - (whole - 1) * DT] + [DT] * (whole - 1)
    for time, acceleration in zip(times, accelerations[len(accelerations) - whole :], strict=True):
        q, v = moved(robot, q, v, acceleration, time)
    np.testing.assert_allclose(ahead.q, q, atol=1e-14)
    np.testing.assert_allclose(ahead.v, v, atol=1e-14)


def test_before_any_command_a_velocity_lasts(robot_named: Load) -> None:
    robot = robot_named("hoap2_like")
    v = 0.1 * np.random.default_rng(6).normal(size=robot.nv)
    here = robot.snapshot(robot.posture("standing"), v)
    ahead = StatePrediction(robot, 0.005, DT).ahead(here)
    np.testing.assert_allclose(ahead.q, robot.integrate(here.q, v, 0.005), atol=1e-14)
    np.testing.assert_array_equal(ahead.v, v)


def test_a_delay_that_is_none_is_refused(robot_named: Load) -> None:
    robot = robot_named("hoap2_like")
    task = wbc.PostureTask(robot, robot.posture("standing"))
    for bad in (-0.001, float("nan")):
        with pytest.raises(InvalidInputError, match="controller, delay"):
            wbc.TorqueController(robot, [task], contacts=(), dt=DT, delay=bad)


def test_a_known_delay_is_as_good_as_none(robot_named: Load) -> None:
    """Oracle: the same loop without delay. The plant is the controller's own model, integrated by
    its accelerations, so a prediction knows all; told nothing, the loop at 8 ms is another one."""
    robot = robot_named("hoap2_like")
    start = robot.snapshot(robot.posture("standing"))

    def motion(late: int, delay: float) -> Array:
        tasks = [
            wbc.ComTask(robot, start.com + (0.01, 0.0, -0.01), kp=400.0, weight=10.0),
            wbc.OrientationTask(robot, "base", start.rotation("base"), name="base"),
            wbc.PostureTask(robot, start.q, weight=0.1),
        ]
        made = wbc.TorqueController(
            robot, tasks, contacts=wbc.support(start, "double"), dt=DT, delay=delay
        )
        q, v = np.array(start.q), np.zeros(robot.nv)
        past, found = deque([(q, v)], maxlen=late + 1), []
        for _ in range(150):
            tick = made.step(robot.snapshot(*past[0]))
            q, v = moved(robot, q, v, tick.acceleration, DT)
            past.append((q, v))
            found.append(robot.snapshot(q).com)
        return np.array(found)

    exact, told, untold = motion(0, 0.0), motion(4, 4 * DT), motion(4, 0.0)
    way = np.abs(exact - exact[0]).max()
    # It begins by what was measured at rest, before any command: 4 ticks, of 150, differ.
    assert np.abs(told - exact).max() < 0.02 * way
    assert np.abs(untold - exact).max() > 5.0 * np.abs(told - exact).max()
