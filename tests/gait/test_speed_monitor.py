"""Whether a walking robot sustains its speed; pushes are seen in what soles do not explain."""

import cmath
import dataclasses
import math

import numpy as np
import pytest

from tests.conftest import load
from wbc.gait import Velocity, Walker
from wbc.gait.legs import bearing_joints
from wbc.gait.phases import GaitState
from wbc.gait.push import PushObserver
from wbc.gait.scheduled_walk import ScheduledWalk, TimedCommand
from wbc.gait.speed_monitor import CHANGE_TIME, PUSH_TIME, STRAIN, SpeedMonitor
from wbc.gait.whole_body import heaviest_link
from wbc.robot import Robot
from wbc.simulation import ModelMismatch, Plant, Sensors, simulate
from wbc.validate import Array

OMEGA, GRAVITY, DT, STEP = 4.0, 9.81, 0.002, 0.4
AHEAD = complex(math.cos(0.3), math.sin(0.3))  # heading


def steps(share, speeds, actual=None, push=0.0):
    """Return the monitor and what it says of each step: strained, and the speed if it deviates.

    Motors are at their limits for a ``share`` of each step, at its end.
    """
    monitor, com, said = SpeedMonitor.of(OMEGA, GRAVITY), 1.0 + 2.0j, []
    ticks = round(STEP / DT)
    for speed, real in zip(speeds, speeds if actual is None else actual, strict=True):
        strained = False
        for k in range(ticks):
            monitor = monitor.update(k >= (1.0 - share) * ticks, speed, push, DT)
            strained |= monitor.is_strained
        com += real * STEP * AHEAD
        said.append((strained, monitor.deviation(com, AHEAD)))
        monitor = monitor.land(com)
    return monitor, said


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_speed_is_sustained_if_motors_are_at_their_limits_for_a_third_of_each_step(share):
    _, said = steps(share, [0.3, 0.6, 0.9, *[1.0] * 10])
    assert set(said) == {(False, None)}


def test_it_is_not_if_they_are_for_most_of_it_and_the_time_is_that_of_the_filter():
    monitor, said = steps(0.8, [1.0] * 6)
    assert said[-1] == (True, None)
    # a first-order filter from rest: 1 - exp(-omega t) passes STRAIN at t = ln(2) / omega
    fresh, time = SpeedMonitor.of(OMEGA, GRAVITY)._replace(unjudged=0.0), 0.0
    while not fresh.is_strained:
        fresh, time = fresh.update(True, 1.0, 0.0, DT), time + DT
    assert time == pytest.approx(-math.log(1.0 - STRAIN) / OMEGA, abs=2.0 * DT)
    assert not monitor.reduced().is_strained  # a reduction takes time


def test_steps_that_are_slower_or_faster_than_commanded_are_told_with_their_speed():
    for real in (0.7, 1.3):
        _, said = steps(0.0, [1.0] * 6, [1.0] * 5 + [real])
        assert said[4] == (False, None) and said[5] == (False, pytest.approx(real))


def test_a_step_may_have_the_speed_of_the_one_before_while_the_command_changes():
    speeds = [0.2, 0.2, 0.2, 0.2, 0.6, 1.0, 1.0]
    _, said = steps(0.0, speeds, [0.2, *speeds[:-1]])
    assert set(said) == {(False, None)}


def test_at_rest_a_small_sway_is_none():
    _, said = steps(0.0, [0.0] * 8, [0.05, -0.05] * 4)
    assert set(said) == {(False, None)}


def test_in_a_turn_steps_of_the_outer_foot_are_longer() -> None:
    """A G1's at 0.48 m/s and 1.14 rad/s, its feet 0.24 m apart: it was slowed down to a half."""
    monitor, _ = steps(0.0, [0.48] * 4)
    for speed in (0.34, 0.503):
        com, ended = monitor.start + speed * STEP * AHEAD, monitor._replace(duration=STEP)
        ended = ended._replace(commanded=0.48 * STEP)
        assert ended.deviation(com, AHEAD, 1.14 * 0.24) is None
    assert ended.deviation(monitor.start + 0.25 * STEP * AHEAD, AHEAD, 1.14 * 0.24)


@pytest.mark.slow
def test_a_robot_that_turns_goes_where_it_faces_as_fast_as_it_is_told() -> None:
    """It went 8 degrees aside, was taken to be slow, and slowed down to a half of that for good."""
    walker, command = Walker(load("g1")), Velocity(0.6, 0.0, 0.9)
    plant, limit = Plant(walker.robot, dt=walker.dt), walker.limits.forwards
    walk = ScheduledWalk(walker, [TimedCommand(0.1, command)], lambda: plant.felt_forces)
    ways = []
    for now in simulate(walker.controller, plant, 6.0, update=walk.update):
        com = now.snapshot.com_velocity
        turn = cmath.rect(1.0, -walker.heading)
        ways += [complex(com[0], com[1]) * turn] if plant.time > 2.4 else []
    way = sum(ways) / len(ways)
    assert walker.limits.forwards == limit and walker.velocity == command
    assert abs(way.imag) < 0.04 * way.real and way.real > 0.9 * command.vx


@pytest.mark.parametrize(("said", "real"), [(None, 0.4), (0.6, 0.6), (0.2, 0.2)])
def test_the_speed_to_a_side_is_judged_along_that_side(said: float | None, real: float) -> None:
    monitor = SpeedMonitor.of(OMEGA, GRAVITY)._replace(start=0j, unjudged=0.0, before=0.4j)
    for _ in range(round(STEP / DT)):
        monitor = monitor.update(False, 0.4j, 0.0, DT)
    speed = monitor.deviation(real * STEP * 1j * AHEAD, AHEAD, along=1j)
    assert speed == (said if said is None else pytest.approx(said))
    assert monitor.deviation(real * STEP * 1j * AHEAD, AHEAD) is None  # nor ahead


@pytest.mark.slow
def test_a_robot_that_does_not_sustain_its_speed_to_a_side_slows_down_and_walks_on() -> None:
    """A G1 with noise fell at what its legs reach sideways, in a second at twice that speed."""
    noise = Sensors(
        position_noise=1e-3, velocity_noise=0.05, base_rotation_noise=1e-3, base_rate_noise=0.05,
        delay=0.002,
    )  # fmt: skip
    walker = Walker(load("g1"))
    plant = Plant(walker.robot, dt=walker.dt, sensors=noise, mismatch=ModelMismatch(mass=1.03))
    side = TimedCommand(0.1, Velocity(0.0, -walker.limits.sideways, 0.0))
    walk = ScheduledWalk(walker, [side], lambda: plant.felt_forces)
    *_, last = simulate(walker.controller, plant, 9.0, update=walk.update)
    assert last.verdict.stood and plant.com[1] < -2.0
    assert walker.limits.sideways == -walker.velocity.vy < 0.35
    assert "m/s sideways was not sustained" in walker.notes[0]
    assert "sustain" in walker.command(0.0, 0.4).reason


def test_nothing_is_judged_at_the_start_and_after_a_push():
    pushed = SpeedMonitor.of(OMEGA, GRAVITY)._replace(unjudged=0.0).update(True, 1.0, 1.0, DT)
    for begin, time in ((pushed, PUSH_TIME), (SpeedMonitor.of(OMEGA, GRAVITY), CHANGE_TIME)):
        monitor, quiet = begin, 0.0
        while not monitor.is_strained:
            assert monitor.deviation(5.0 + 0.0j, 1.0 + 0.0j) is None
            monitor, quiet = monitor.update(True, 1.0, 0.0, DT), quiet + DT
        assert quiet == pytest.approx(time / OMEGA, abs=2.0 * DT)


def walk(walker, speed, seconds):
    """Walk in physics; return the last tick and the plant."""
    plant = Plant(walker.robot, dt=walker.dt)
    walk = ScheduledWalk(
        walker, [TimedCommand(0.2, Velocity(speed, 0.0, 0.0))], lambda: plant.felt_forces
    )
    *_, last = simulate(walker.controller, plant, seconds, update=walk.update)
    return last, plant, walk


def half_strong(robot, speed):
    """A walker with half of its torques, told that its hips can swing at this speed."""
    walker = Walker(robot, torque_limits=0.5)
    walker.limits = dataclasses.replace(walker.limits, forwards=speed)
    return walker


@pytest.mark.slow
def test_a_robot_of_half_its_torque_slows_down_and_walks_on_where_it_fell():
    robot, speed, seconds = load("g1"), 1.1, 6.0
    walker = half_strong(robot, speed)
    walker._slow_down = lambda aside, why: None
    now, _, _ = walk(walker, speed, seconds)
    assert not now.verdict.stood and not walker.notes[1:]
    walker = half_strong(robot, speed)
    now, plant, run = walk(walker, speed, seconds)
    assert now.verdict.stood and float(plant.com[0]) > 3.0
    assert walker.limits.forwards < speed and walker.wanted.vx == walker.limits.forwards
    first = walker.notes[1]
    assert first.startswith("1.10 m/s was not sustained") and first in run.notes
    assert "sustain" in walker.command(speed).reason
    walker.limits = dataclasses.replace(walker.limits, forwards=speed)
    assert not walker.command(speed).reason


def test_a_knee_without_a_motor_is_not_at_its_torque_limit():
    """Linkages drive it: its 0 N m were its limit, and a biped slowed down to a third."""
    robot = Robot.load("hoap2_like", unactuated=["*_knee*"])
    legs = [robot.joint_names[k] for k in bearing_joints(robot)]
    assert legs and not any("knee" in name for name in legs)


def test_hips_and_knees_without_motors_are_never_at_their_torque_limits():
    """Linkages may drive all of them: an index of no joints was an IndexError."""
    robot = Robot.load("hoap2_like", unactuated=["*_knee*", "*_hip*"])
    walker = Walker(robot)
    tick = walker.step(robot.snapshot(robot.posture()))
    assert not bearing_joints(robot).size
    assert tick.ok and walker.limits.why[0] != "speed that it was seen to sustain"


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
