"""States predicted over a known delay: exact where the model is, and worth it in a loop."""

from collections import deque

import numpy as np
import pytest

import wbc
from wbc.controllers.prediction import StatePrediction
from wbc.gait import Walker
from wbc.robot import Robot
from wbc.validate import Array

DT = 0.002


def moved(robot: Robot, q: Array, v: Array, a: Array, time: float) -> tuple[Array, Array]:
    """The motion at a constant acceleration, by the law that predictions are integrated by."""
    later = v + time * a
    return robot.integrate(q, 0.5 * (v + later), time), later


@pytest.mark.parametrize("delay", [DT, 2 * DT, 3 * DT, 1.5 * DT, 0.4 * DT])
def test_a_prediction_is_the_motion_by_what_was_commanded(delay: float, hoap2: Robot) -> None:
    """Whole ticks and parts of one: the state at the delay's end, to rounding."""
    robot, rng = hoap2, np.random.default_rng(5)
    accelerations = rng.normal(size=(6, robot.nv))
    prediction = StatePrediction(robot, delay, DT)
    for acceleration in accelerations:
        prediction.record(acceleration)
    q, v = robot.posture("standing"), 0.1 * rng.normal(size=robot.nv)
    here = robot.snapshot(q, v)
    ahead = prediction.predict(here)
    assert prediction.predict(here) is ahead  # asked again in a tick
    whole = int(np.ceil(delay / DT - 1e-9))
    times = [delay - (whole - 1) * DT] + [DT] * (whole - 1)
    for time, acceleration in zip(times, accelerations[len(accelerations) - whole :], strict=True):
        q, v = moved(robot, q, v, acceleration, time)
    np.testing.assert_allclose(ahead.q, q, atol=1e-14)
    np.testing.assert_allclose(ahead.v, v, atol=1e-14)


def test_a_snapshot_that_is_given_again_is_as_one_made_anew(hoap2: Robot) -> None:
    """As of a sensor that is slower than the loop."""
    q, v = hoap2.posture("standing"), np.full(hoap2.nv, 0.1)
    commands = []
    for again in (lambda here: here, lambda here: hoap2.snapshot(here.q, here.v)):
        task = wbc.PostureTask(hoap2, q)
        made = wbc.TorqueController(hoap2, [task], contacts=(), dt=DT, delay=2 * DT)
        here = hoap2.snapshot(q, v)
        for _ in range(3):
            tick = made.step(again(here))
        commands.append(tick.torque)
    np.testing.assert_array_equal(*commands)


def test_before_any_command_a_velocity_lasts(hoap2: Robot) -> None:
    v = 0.1 * np.random.default_rng(6).normal(size=hoap2.nv)
    here = hoap2.snapshot(hoap2.posture("standing"), v)
    ahead = StatePrediction(hoap2, 0.005, DT).predict(here)
    np.testing.assert_allclose(ahead.q, hoap2.integrate(here.q, v, 0.005), atol=1e-14)
    np.testing.assert_array_equal(ahead.v, v)


def test_first_commands_act_at_the_delays_end(hoap2: Robot) -> None:
    """Given at 0 and 2 ms they act from 5 and 7 ms on: known at 2 and 4 ms. The robot glided after
    them, by a velocity that it does not have before."""
    accelerations = np.random.default_rng(7).normal(size=(2, hoap2.nv))
    prediction = StatePrediction(hoap2, 0.005, DT)
    here = hoap2.snapshot(hoap2.posture("standing"), np.full(hoap2.nv, 0.1))
    q, v = hoap2.integrate(here.q, here.v, 0.001), here.v
    for acceleration in accelerations:
        prediction.record(acceleration)
        q, v = moved(hoap2, q, v, acceleration, DT)
    np.testing.assert_allclose(prediction.predict(here).q, q, atol=1e-14)


def test_a_delay_in_ms_is_said(hoap2: Robot, caplog: pytest.LogCaptureFixture) -> None:
    task = wbc.PostureTask(hoap2, hoap2.posture("standing"))
    wbc.TorqueController(hoap2, [task], contacts=(), dt=DT, delay=4.0)
    assert "a delay of 4 s" in caplog.text and "in s?" in caplog.text


def test_a_known_delay_is_as_good_as_none(hoap2: Robot) -> None:
    """Oracle: the same loop without delay. The plant is the controller's own model, integrated by
    its accelerations, so a prediction knows all; told nothing, the loop at 8 ms is another one."""
    start = hoap2.snapshot(hoap2.posture("standing"))

    def motion(late: int, delay: float) -> Array:
        tasks = [
            wbc.ComTask(hoap2, start.com + (0.01, 0.0, -0.01), kp=400.0, weight=10.0),
            wbc.OrientationTask(hoap2, "base", start.rotation("base"), name="base"),
            wbc.PostureTask(hoap2, start.q, weight=0.1),
        ]
        made = wbc.TorqueController(
            hoap2, tasks, contacts=wbc.support(start, "double"), dt=DT, delay=delay
        )
        q, v = np.array(start.q), np.zeros(hoap2.nv)
        past, found = deque([(q, v)], maxlen=late + 1), []
        for _ in range(150):
            tick = made.step(hoap2.snapshot(*past[0]))
            q, v = moved(hoap2, q, v, tick.acceleration, DT)
            past.append((q, v))
            found.append(hoap2.snapshot(q).com)
        return np.array(found)

    exact, told, untold = motion(0, 0.0), motion(4, 4 * DT), motion(4, 0.0)
    np.testing.assert_allclose(told, exact, atol=1e-12)
    assert np.abs(untold - exact).max() > 0.05 * np.abs(exact - exact[0]).max()


@pytest.mark.parametrize("walks", [False, True])
def test_a_reset_controller_begins_as_a_new_one(hoap2: Robot, walks: bool) -> None:
    """It predicted the first ticks of another episode by the last torques of the one before."""
    start = hoap2.snapshot(hoap2.posture("standing"))
    contacts = wbc.support(start, "double")
    made, walker = None, None
    if walks:
        walker = Walker(hoap2, dt=DT, delay=2 * DT, solver="active_set")
    else:
        tasks = [wbc.ComTask(hoap2, start.com), wbc.PostureTask(hoap2, start.q, weight=0.1)]
        settings = {"contacts": contacts, "dt": DT, "delay": 2 * DT, "solver": "active_set"}
        made = wbc.TorqueController(hoap2, tasks, **settings)

    def ticks(speed: float, place: float) -> Array:
        q = np.array(start.q)
        q[0] += place  # the walker notices by itself
        here = hoap2.snapshot(q, np.r_[speed, np.zeros(hoap2.nv - 1)])
        answers = []
        for _ in range(4):
            at = hoap2.snapshot(here.q, here.v)
            step = walker.step if walker is not None else made.step
            answers.append(step(at).torque)
        return np.array(answers)

    expected = ticks(0.0, 0.0)
    ticks(0.3, 0.0)
    if made is not None:
        made.set_contacts(contacts[:1])
        made.step(start)
        made.reset()
        assert [one.name for one in made.contacts] == [contacts[0].name]
        made.set_contacts(contacts)
        assert made.last_torque is None
    np.testing.assert_allclose(ticks(0.0, 0.5 * walks), expected, atol=1e-8)
