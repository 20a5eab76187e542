"""Limits: no overshoot, no oscillation, rest always allowed, and a way back from outside."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

import wbc
from tests import urdf
from wbc.constraints import Limits
from wbc.errors import InvalidInputError, WbcError
from wbc.robot import Robot

DT = 0.005


def at(robot: Robot, joints: np.ndarray) -> np.ndarray:
    """Configuration with the given joint positions, continuous joints included."""
    step = np.concatenate((np.zeros(6), joints - robot.limits.joint_positions(neutral(robot))))
    return robot.integrate(neutral(robot), step, 1.0)


def neutral(robot: Robot) -> np.ndarray:
    return robot.postures["neutral"]


def inside(robot: Robot, rng: np.random.Generator) -> np.ndarray:
    lower, upper = (np.clip(x, -3, 3) for x in (robot.limits.lower, robot.limits.upper))
    return rng.uniform(lower, upper)


@pytest.mark.slow
@pytest.mark.parametrize("direction", [-1, 1])
def test_full_speed_at_a_limit_stops_there(robot: Robot, rng, direction: int) -> None:
    """The greediest command allowed, tick after tick: an adversary no task can exceed."""
    a_max = 30.0
    limits = Limits(robot, acceleration=a_max)
    q, v = at(robot, inside(robot, rng)), np.zeros(robot.nv)
    end = limits.upper if direction > 0 else limits.lower
    bounded = np.isfinite(end)
    for _ in range(4000):
        lower, upper = limits.box(robot.snapshot(q, v), DT)
        command = np.zeros(robot.nv)
        command[6:] = (upper if direction > 0 else lower)[6:]
        change = np.abs(command - v)[6:]
        # Speeding up and braking both stay within the acceleration limit (rounding 1e-9).
        assert (change <= a_max * DT + 1e-9)[bounded].all()
        assert (direction * command[6:] >= 0).all(), "it must never turn back"
        v = command
        q = robot.integrate(q, v, DT)
        position = robot.limits.joint_positions(q)
        assert (direction * (end - position)[bounded] >= -1e-12).all()
    # It creeps up to the limit like a / (t^2): within a micro-radian after 20 s.
    np.testing.assert_allclose(position[bounded], end[bounded], atol=1e-6)


def test_rest_is_always_allowed(robot: Robot, rng) -> None:
    limits = Limits(robot)
    for _ in range(50):
        joints = inside(robot, rng) + rng.normal(size=robot.nv - 6)  # often outside
        v = rng.normal(scale=20, size=robot.nv)
        lower, upper = limits.emergency_braking_box(robot.snapshot(at(robot, joints), v), DT)
        assert (lower <= 0).all()
        assert (upper >= 0).all()


def test_bounded_braking_joint_by_joint(robot: Robot, rng) -> None:
    """Of what a joint may do if it may stop at once, the part nearest to its present velocity."""
    free, bounded = Limits(robot), Limits(robot, braking="bounded")
    change = free.acceleration * DT
    kept = forced = 0
    for _ in range(50):
        joints = inside(robot, rng) + 0.1 * rng.normal(size=robot.nv - 6)  # some outside
        v = np.concatenate((np.zeros(6), rng.normal(size=robot.nv - 6) * robot.limits.velocity))
        here = robot.snapshot(at(robot, joints), v)
        (low, high), (least, most) = free.box(here, DT), bounded.box(here, DT)
        for k in range(6, robot.nv):
            gain = change[k - 6]
            ends = (low[k], v[k] - gain, v[k] + gain, high[k])
            within = [x for x in ends if low[k] <= x <= high[k]]
            allowed = [x for x in within if abs(x - v[k]) <= gain + 1e-12]
            if allowed:
                kept += 1
                assert least[k] == pytest.approx(min(allowed), abs=1e-12)
                assert most[k] == pytest.approx(max(allowed), abs=1e-12)
            else:  # the joint's own limit asks for more: just what it asks for
                forced += 1
                nearest = high[k] if v[k] > 0 else low[k]
                assert least[k] == most[k] == pytest.approx(nearest, abs=1e-12)
    assert kept > 50 and forced > 50


def test_velocity_and_base_twist(robot: Robot) -> None:
    twist = np.arange(1.0, 7.0)
    limits = Limits(robot, velocity=0.5, acceleration=np.inf, base_twist=twist)
    middle = (np.clip(robot.limits.lower, -3, 3) + np.clip(robot.limits.upper, -3, 3)) / 2
    lower, upper = limits.box(robot.snapshot(at(robot, middle)), DT)
    np.testing.assert_array_equal(upper[:6], twist)
    np.testing.assert_array_equal(lower[:6], -twist)
    np.testing.assert_allclose(upper[6:], 0.5 * robot.limits.velocity)


def test_outside_may_only_move_back(robot: Robot) -> None:
    limits = Limits(robot, recovery=0.2)
    bounded = np.flatnonzero(np.isfinite(robot.limits.upper))
    joint = int(bounded[0])
    joints = np.where(np.isfinite(robot.limits.upper), robot.limits.upper, 0.0)
    joints[joint] += 0.05
    here = robot.snapshot(at(robot, joints))
    assert limits.box(here, DT)[1][6 + joint] == 0.0
    assert limits.worst_margin(here.q)[1] == robot.joint_names[joint]
    assert limits.worst_margin(here.q)[0] == pytest.approx(-0.05)


def test_without_limits_nothing_is_bounded(robot: Robot) -> None:
    nothing = Limits(robot, position=False, velocity=None)
    here = robot.snapshot(neutral(robot))
    lower, upper = nothing.box(here, DT)
    np.testing.assert_array_equal(lower, np.full(robot.nv, -np.inf))
    np.testing.assert_array_equal(upper, np.full(robot.nv, np.inf))
    # Without a range speed and acceleration bound as ever, and nothing has to be taken back.
    no_range = Limits(robot, position=False, acceleration=7.0)
    far = np.where(np.isfinite(robot.limits.upper), robot.limits.upper + 0.5, 0.3)
    moving = robot.snapshot(at(robot, far), np.zeros(robot.nv))
    box = no_range.box(moving, DT)
    np.testing.assert_allclose(box[1][6:], np.minimum(robot.limits.velocity, 7.0 * DT))
    np.testing.assert_allclose(box[0][6:], -box[1][6:])


def test_accelerations_joint_by_joint(robot: Robot) -> None:
    each = np.linspace(1.0, 9.0, robot.nv - 6)
    limits = Limits(robot, acceleration=each)
    np.testing.assert_array_equal(limits.acceleration, each)
    with pytest.raises(InvalidInputError, match="limits, acceleration: expected shape"):
        Limits(robot, acceleration=each[1:])


@pytest.mark.parametrize("braking", ["free", "bounded"])
def test_joints_speed_up_as_they_may_and_brake_as_they_can(robot: Robot, rng, braking: str) -> None:
    """Towards where it goes by the one, against it and at the limits by the other."""
    limits = Limits(robot, acceleration=20.0, speed_up=50.0, braking=braking)
    slow, fast = (Limits(robot, acceleration=a, braking=braking) for a in (20.0, 50.0))
    middle = (np.clip(robot.limits.lower, -3, 3) + np.clip(robot.limits.upper, -3, 3)) / 2
    v = np.zeros(robot.nv)
    v[6:] = rng.choice((-1.0, 1.0), robot.nv - 6) * 0.2
    here, ahead = robot.snapshot(at(robot, middle), v), v[6:] > 0.0
    (low, high), (braked, _), (_, risen) = (one.box(here, DT) for one in (limits, slow, fast))
    np.testing.assert_allclose(high[6:][ahead], risen[6:][ahead], rtol=1e-12)
    if braking == "bounded":
        np.testing.assert_allclose(low[6:][ahead], braked[6:][ahead], rtol=1e-12)
    near = np.where(np.isfinite(robot.limits.upper), robot.limits.upper - 1e-3, 0.0)
    near = robot.snapshot(at(robot, near), np.full(robot.nv, 0.2))
    bounded = np.append(np.zeros(6, bool), np.isfinite(robot.limits.upper))
    (_, stops), (_, expected) = (one.box(near, DT) for one in (limits, slow))
    np.testing.assert_allclose(stops[bounded], expected[bounded], rtol=1e-12)
    limits.speed_up = None
    np.testing.assert_array_equal(limits.box(here, DT), slow.box(here, DT))
    with pytest.raises(InvalidInputError, match=r"limits, speed_up: every entry must be positive"):
        Limits(robot, speed_up=0.0)


def test_other_accelerations_and_other_steps_count_from_the_next_tick_on(robot: Robot) -> None:
    here = robot.snapshot(robot.posture("standing"), np.full(robot.nv, 0.01))
    limits = Limits(robot, acceleration=20.0)
    first = limits.box(here, 0.005)
    assert not np.array_equal(first, limits.box(here, 0.001))
    assert np.array_equal(first, limits.box(here, 0.005))
    limits.acceleration = 0.1 * limits.acceleration
    given, fresh = limits.box(here, 0.005), Limits(robot, acceleration=2.0).box(here, 0.005)
    np.testing.assert_allclose(given, fresh, rtol=1e-12)
    assert not np.array_equal(given, first)


def test_a_continuous_joint_has_its_speed_only(robot_named) -> None:
    robot = robot_named("mixed_joints")
    free = [6 + k for k in robot.limits.unbounded]
    assert free
    limits = Limits(robot, acceleration=np.inf)
    lower, upper = limits.box(robot.snapshot(neutral(robot)), DT)
    np.testing.assert_array_equal(upper[free], robot.limits.velocity[list(robot.limits.unbounded)])
    np.testing.assert_array_equal(lower[free], -upper[free])
    fast = Limits(robot, velocity=None, acceleration=np.inf)
    assert np.isinf(fast.box(robot.snapshot(neutral(robot)), DT)[1][free]).all()


def test_a_robot_without_joints_has_no_worst_one() -> None:
    stone = Robot.load(urdf.stone(), base="floating")
    limits = Limits(stone)
    assert limits.worst_margin(stone.postures["neutral"]) == (np.inf, "no joint")
    assert limits.box(stone.snapshot(stone.postures["neutral"]), DT)[0].shape == (6,)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"recovery": 1.5}, r"^limits, recovery: 1\.5 is above 1 \(all in one tick\)"),
        ({"base_twist": [1.0]}, r"base_twist: expected shape \(6,\)"),
        ({"position": False, "margin": 0.1}, r"margin=0\.1 has no effect with position=False"),
        ({"braking": "fre"}, r"unknown kind of braking 'fre'; did you mean 'free'"),
    ],
)
def test_each_mistake_is_named(robot: Robot, given: dict, told: str) -> None:
    with pytest.raises(WbcError, match=told):
        Limits(robot, **given)


@pytest.mark.parametrize("name", ["g1", "hoap2_like"])
def test_half_of_the_torques_are_counted_on_to_accelerate(robot_named, name: str) -> None:
    """By what each joint carries in the standing posture, the diagonal of Pinocchio's own CRBA."""
    robot = robot_named(name)
    data = robot.model.createData()
    M = pin.crba(robot.model, data, robot.posture("standing"))
    carried = np.diagonal(M)[6:]
    plain = Limits(robot)
    torques = 1.8 * carried * plain.acceleration * np.where(np.arange(carried.size) % 2, 1.0, 2.0)
    weak = plain.within_torques(torques)
    expected = plain.acceleration * np.where(np.arange(carried.size) % 2, 0.9, 1.0)
    np.testing.assert_allclose(weak.acceleration, expected, rtol=1e-9)
    np.testing.assert_array_equal(plain.acceleration, Limits(robot).acceleration)
    given = Limits(robot, acceleration=5.0)
    np.testing.assert_array_equal(given.within_torques(torques).acceleration, 5.0)
    plain.speed = 0.5  # is assigned to what a torque controller made of these
    np.testing.assert_array_equal(weak.speed, 0.5)
    weak.speed = 0.4
    np.testing.assert_array_equal(plain.speed, 0.5)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(plain)).speed, 0.5)


def test_assigned_accelerations_are_kept_by_a_torque_controller_as_given_ones(hoap2: Robot) -> None:
    """Before or after it is made: more than half of the torques, and less."""
    standing, plain = hoap2.posture("standing"), Limits(hoap2)
    elbow = hoap2.joint_names.index("left_elbow_pitch")
    q, v = standing.copy(), np.zeros(hoap2.nv)
    q[7 + elbow], v[6 + elbow] = plain.upper[elbow] - 0.01, 1.5  # braked by what counts on it
    here, tasks = hoap2.snapshot(q, v), [wbc.PostureTask(hoap2, standing)]

    def controller(limits: Limits) -> wbc.Controller:
        contacts = wbc.support(here, "double")
        return wbc.TorqueController(hoap2, tasks, contacts=contacts, limits=limits)

    wanted = controller(Limits(hoap2, acceleration=2000.0)).step(here).torque
    assert not np.allclose(controller(plain).step(here).torque, wanted)
    early, late = Limits(hoap2), Limits(hoap2)
    early.acceleration = 2000.0
    controllers = controller(early), controller(late)
    late.acceleration = 2000.0
    for one in controllers:
        np.testing.assert_array_equal(one.step(here).torque, wanted)
        np.testing.assert_array_equal(one.limits.acceleration, 2000.0)


def test_one_bad_acceleration_among_good_ones_is_refused(hoap2) -> None:
    for bad in (0.0, -1.0):
        acceleration = np.full(hoap2.nv - 6, 10.0)
        acceleration[3] = bad
        with pytest.raises(InvalidInputError, match="acceleration: every entry must be positive"):
            Limits(hoap2, acceleration=acceleration)


def test_what_is_assigned_is_checked_as_what_is_given(robot: Robot) -> None:
    limits = Limits(robot)
    for name in ("speed", "acceleration"):
        for bad in (-1.0, 0.0, np.nan, np.full(3, 1.0), "fast", np.full(robot.nv - 6, -1.0)):
            with pytest.raises(InvalidInputError, match=f"^limits, {name}: "):
                setattr(limits, name, bad)
    for name, bad, told in (
        ("recovery", 1.5, "above 1"),
        ("recovery", 0.0, "greater than 0"),
        ("braking", "fre", "did you mean 'free'"),
    ):
        with pytest.raises(WbcError, match=told):
            setattr(limits, name, bad)
    mine = np.full(robot.nv - 6, 0.25)
    limits.speed, limits.acceleration = mine, np.inf
    mine[:] = 9.0  # the caller's own
    upper = limits.box(robot.snapshot(robot.posture()), DT)[1][6:]
    assert upper.max() == 0.25
    assert np.isinf(limits.acceleration).all()
