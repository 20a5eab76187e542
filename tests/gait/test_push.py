"""A push is seen in the motion that soles do not explain; walking and wrong masses are none."""

import numpy as np
import pytest

from wbc.gait import Walker
from wbc.gait.phases import GaitState
from wbc.gait.push import PushObserver
from wbc.gait.whole_body import heaviest_link
from wbc.robot import Robot
from wbc.simulation import ModelMismatch, Plant, Sensors
from wbc.validate import Array

START, LASTING, FORCE = 0.3, 0.1, np.array((3.0, 5.0, 0.0))  # s, s, N


def observed(robot: Robot) -> tuple[Array, Array, PushObserver]:
    """Times, what is observed (n, 2), by which observer, of a walk with wrong masses and noise."""
    plant = Plant(
        robot,
        dt=0.002,
        sensors=Sensors(position_noise=1e-3, velocity_noise=0.05, delay=0.002, seed=3),
        mismatch=ModelMismatch(mass=1.1),
    )
    walker = Walker(robot, dt=0.002)
    gait, frames = walker.gait, {foot: sole.frame for foot, sole in robot.feet.items()}
    observer, found, times = PushObserver(gait.omega, gait.height), [], []
    walker.command(0.1)
    plant.push(heaviest_link(robot), FORCE, start=START, duration=LASTING)
    while plant.time < START + LASTING + 0.16:
        snapshot, forces = plant.snapshot(), plant.contact_forces
        now = GaitState.of(snapshot, frames, gait.omega, gait.height)
        felt = {foot: forces[frame] for foot, frame in frames.items()}
        observer = observer.update(snapshot, now, felt, 0.002)
        found.append((observer.push.real, observer.push.imag))
        times.append(plant.time)
        plant.step(walker.step(snapshot, forces).torque)
    return np.array(times), np.array(found), observer


def test_a_push_is_seen_and_a_walk_is_none(hoap2: Robot) -> None:
    times, found, observer = observed(hoap2)
    at = (times > START + 0.06) & (times < START + LASTING)
    seen, pushed = found[at].mean(axis=0), FORCE[:2] / (1.1 * hoap2.mass)
    # at the trunk, above the CoM: the angular momentum adds to what is carried
    assert (seen > 0.8 * pushed).all() and (seen < 1.8 * pushed).all()
    quiet = (times > 0.1) & ((times < START) | (times > START + LASTING + 0.12))
    assert np.linalg.norm(found[quiet], axis=1).max() < 0.35 * np.linalg.norm(pushed)
    start = hoap2.snapshot(hoap2.posture("standing"))
    frames = {foot: sole.frame for foot, sole in hoap2.feet.items()}
    now = GaitState.of(start, frames, observer.omega, observer.height)
    blind = observer.update(start, now, {}, 0.002)  # not felt any more
    assert blind.expected is None and not blind.push
    assert blind.predict(now, 0.01).dcm == now.dcm


@pytest.mark.parametrize("delay", [0.0, 0.01])
def test_the_capture_point_is_where_the_push_takes_it(delay: float) -> None:
    """After a quarter of the time constant and the delay, by a simulation of the pendulum."""
    omega, a = 4.0, 1.0 - 2.0j
    now = GaitState(0.02 + 0.01j, {}, {})
    ahead = PushObserver(omega, 0.6, 0j, a).predict(now, delay)
    xi, steps = now.dcm, 1000
    for _ in range(steps):  # the pressure is at the DCM, so that only the push moves it
        xi = xi + (0.25 / omega + delay) / steps * a / omega
    assert ahead.dcm == pytest.approx(xi, rel=1e-12)
