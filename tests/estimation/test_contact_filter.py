"""The invariant filter against the paper's matrices; forces from outside against Pinocchio's."""

import copy
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2
from swaying_base import DT, NOISE, PLACE, Moment, swaying

import wbc
from tests.estimation.textbook import Textbook
from wbc.errors import InvalidInputError
from wbc.estimation import (
    ContactFilter,
    FilterNoise,
    ImuReading,
    Measurement,
    MomentumObserver,
    StateEstimator,
)
from wbc.hardware.postures import standing_torque
from wbc.robot import Robot
from wbc.robot.passive import PassiveForces, Spring
from wbc.rotations import exp_rotation, log_rotation
from wbc.validate import Array


def begun(rng: np.random.Generator, noise: FilterNoise = NOISE) -> tuple[ContactFilter, Textbook]:
    """A filter anywhere with two feet held, and the same in matrices."""
    R, v, p = exp_rotation(rng.normal(size=3)), rng.normal(size=3), rng.normal(size=3)
    bg, ba = 0.1 * rng.normal(size=3), 0.3 * rng.normal(size=3)
    L = 0.05 * rng.normal(size=(15, 15))
    f = ContactFilter(2, noise)
    f.reset(R, p, v, bg, ba, L @ L.T)
    for k in range(2):
        f.hold(k, seen(rng), PLACE)
    book = Textbook(R, v, p, [f.foot(k) for k in range(2)], noise, bg, ba, f.invariant_covariance)
    book.p, book.feet = p - p, [(d - p, own) for d, own in book.feet]  # its origin is at the start
    return f, book


def seen(rng: np.random.Generator) -> Array:
    return np.concatenate((rng.normal(size=3), exp_rotation(rng.normal(size=3)).ravel()))


def test_prediction_and_correction_are_the_papers(rng: np.random.Generator) -> None:
    f, book = begun(rng)
    origin = f.position
    for i in range(4):
        rate, force = 2.0 * rng.normal(size=3), 8.0 * rng.normal(size=3)
        f.predict(rate, force, 0.004)
        book.predict(rate, force, 0.004)
        # The transition is of second order: dt^3 |A|^3 / 6 = 4e-6 of the covariance's 0.1.
        assert np.allclose(f.invariant_covariance, book.P, atol=3e-6)
        book.P = f.invariant_covariance  # from here on the correction alone is looked at
        d, own = book.feet[i % 2]
        off = exp_rotation(0.05 * rng.normal(size=3)) @ book.R.T
        place = np.concatenate((book.R.T @ (d - book.p) + 0.02, (off @ own).ravel()))
        found, squared = f.correct(i % 2, place, PLACE), book.correct(i % 2, place, PLACE)
        assert found.squared == pytest.approx(squared, rel=1e-8)
        assert np.allclose(f.rotation, book.R, atol=1e-8)  # 400 steps of a midpoint rule
        assert np.allclose(f.velocity, book.v, atol=1e-8)
        assert np.allclose(f.position - origin, book.p, atol=1e-8)
        assert np.allclose(f.gyroscope_bias, book.bg, atol=1e-9)
        assert np.allclose(f.accelerometer_bias, book.ba, atol=1e-8)
        assert np.allclose(f.foot(1)[0] - origin, book.feet[1][0], atol=1e-8)
        assert np.allclose(f.invariant_covariance, book.P, atol=1e-10)


def test_error_moves_as_finite_differences_say(rng: np.random.Generator) -> None:
    still, size, dt = FilterNoise(*(0.0,) * 6), 1e-5, 0.01
    R, v, p = exp_rotation(rng.normal(size=3)), rng.normal(size=3), np.zeros(3)
    error = size * rng.normal(size=15)
    error[6:9] = 0.0  # a filter's origin is at its start: p itself is no error
    E = exp_rotation(error[:3])
    f, g = ContactFilter(0, still), ContactFilter(0, still)
    plain = error.copy()  # the invariant error as estimate minus truth
    plain[3:6] = E @ v + error[3:6] - v
    f.reset(R, p, v, covariance=np.outer(plain, plain))
    g.reset(E @ R, p, v + plain[3:6], error[9:12], error[12:15])
    rate, force = 3.0 * rng.normal(size=3), 10.0 * rng.normal(size=3)
    f.predict(rate, force, dt)
    g.predict(rate, force, dt)
    turn = g.rotation @ f.rotation.T
    moved = np.concatenate(
        (log_rotation(turn), g.velocity - turn @ f.velocity, g.position - turn @ f.position)
    )
    P = f.invariant_covariance[:9, :9]
    # Of the order of the error squared, and of dt^3 in the biases' columns.
    assert np.allclose(P, np.outer(moved, moved), atol=2e-3 * np.abs(P).max())


def followed(
    seed: int, steps: int, swing: float = 1.0
) -> Iterator[tuple[Moment, ContactFilter, float]]:
    """Yield moments, the filter there, and the NIS of both feet: 12 rows."""
    start, moments = swaying(seed, steps, swing)
    f = start.filter()
    for now in moments:
        f.predict(now.rate, now.force, DT)
        yield now, f, sum(f.correct(k, *one).squared for k, one in enumerate(now.feet))


def test_innovations_are_as_large_as_said() -> None:
    """NIS of 12 rows over 10 runs of 200 corrections: inside its 99.9 % bounds."""
    total = sum(nis for seed in range(10) for _, _, nis in followed(seed, 200))
    low, high = chi2.ppf((0.0005, 0.9995), 12 * 200 * 10)
    assert low < total < high


def test_biases_are_found_and_errors_are_as_large_as_said() -> None:
    *_, (now, f, _) = followed(11, 1500, swing=1.5)
    P = f.covariance
    found = np.concatenate((f.gyroscope_bias, f.accelerometer_bias)) - now.biases
    deviations = np.sqrt(np.diag(P)[9:])
    assert np.all(np.abs(found) < 4.0 * deviations)
    # From 0.02 rad/s and 0.1 m/s^2: a gyroscope's is seen at once by feet that do not turn.
    assert np.all(deviations < np.repeat((0.005, 0.05), 3))
    error = np.concatenate((log_rotation(f.rotation @ now.R.T)[:2], f.velocity - now.v))
    chosen = np.ix_([0, 1, 3, 4, 5], [0, 1, 3, 4, 5])
    assert error @ np.linalg.solve(P[chosen], error) < chi2.ppf(0.9999, 5)


def test_heading_and_position_only_grow_less_sure() -> None:
    said = [np.diag(f.covariance) for _, f, _ in followed(3, 400)]
    yaw, place = np.array([(d[2], d[6] + d[7]) for d in said]).T
    assert yaw[-1] > 10.0 * yaw[10]
    assert np.all(np.diff(place[50:]) > -1e-9)


def test_a_far_walk_is_the_same_from_any_origin(rng: np.random.Generator) -> None:
    """Beyond 10 m the filter's origin moves along; what it says does not change by that."""
    near, far = ContactFilter(1, NOISE), ContactFilter(1, NOISE)
    R, v, L = exp_rotation(rng.normal(size=3)), np.array((3.0, 0.0, 0.0)), np.eye(15) * 0.01
    for f, p in ((near, np.zeros(3)), (far, np.array((5.0, 5.0, 0.0)))):
        f.reset(R, p, v, covariance=L)
    for i in range(1000):
        white = rng.normal(size=6)
        for f in (near, far):
            f.predict(0.1 * white[:3], R.T @ (0.0, 0.0, 9.81) + white[3:], 0.01)
            if i in (500, 800):
                f.hold(0, np.concatenate(((0.1, 0.0, -0.8), np.eye(3).ravel())), PLACE)
            if i == 700:
                f.release(0)
    assert np.linalg.norm(near.position) > 20.0
    assert np.allclose(far.position - near.position, (5.0, 5.0, 0.0), atol=1e-9)
    assert np.allclose(near.foot(0)[0] - near.position, far.foot(0)[0] - far.position, atol=1e-9)
    assert np.allclose(near.covariance, far.covariance, rtol=1e-6, atol=1e-9)


def test_gate_leaves_everything_as_it_was_and_memory_comes_back_to_the_bit(rng) -> None:
    f, _ = begun(rng)
    kept = f.memory()
    place = seen(rng)
    assert not f.correct(0, place, PLACE, gate=1.0).taken
    assert f.memory()[0].tobytes() == kept[0].tobytes()
    f.correct(0, place, PLACE)
    f.release(1)
    assert not np.any(f.invariant_covariance[21:27])
    f.restore(kept)
    assert f.memory()[0].tobytes() == kept[0].tobytes()
    assert f.held == (True, True)


def test_a_filter_refuses_what_is_no_state() -> None:
    f = ContactFilter(1)
    with pytest.raises(InvalidInputError, match="not a rotation"):
        f.reset(2.0 * np.eye(3), np.zeros(3))
    with pytest.raises(InvalidInputError, match="filter noise, creep"):
        FilterNoise(creep=-1.0)
    f.reset(np.eye(3), np.zeros(3))
    place = np.concatenate((np.zeros(3), np.eye(3).ravel()))
    f.hold(0, place, np.zeros((6, 6)))
    with pytest.raises(InvalidInputError, match="no positive covariance"):
        f.correct(0, place, np.zeros((6, 6)))


def test_a_filter_takes_no_feet_in_the_air_and_no_numbers_that_are_none() -> None:
    """A foot in the air corrected the estimate by an empty place; -1 was the last one's."""
    f, place = ContactFilter(2), np.concatenate((np.zeros(3), np.eye(3).ravel()))
    f.hold(0, place, np.eye(6))
    kept = f.memory()[0].tobytes()
    no_rotation = np.concatenate((np.zeros(3), 2.0 * np.eye(3).ravel()))
    refused: dict[str, Callable[[], object]] = {
        "foot 1 is not in contact": lambda: f.correct(1, place, np.eye(6)),
        "foot 1 is not in contact; hold": lambda: f.foot(1),
        "filter, foot: must be at least 0": lambda: f.foot(-1),
        "filter, foot: must be at most 1": lambda: f.foot(5),
        "not a rotation": lambda: f.correct(0, no_rotation, np.eye(6)),
        "noise of a foot: is no covariance": lambda: f.hold(0, place, -np.eye(6)),
        "filter, covariance: is no": lambda: f.reset(
            np.eye(3), np.zeros(3), covariance=np.triu(np.ones((15, 15)))
        ),
        "filter, gate": lambda: f.correct(0, place, np.eye(6), gate=np.nan),
        "filter, gate: expected a number": lambda: f.correct(0, place, np.eye(6), gate="3"),
        "filter, rotation: expected True": lambda: f.correct(0, place, np.eye(6), rotation="no"),
        "filter, scale": lambda: f.predict(np.zeros(3), np.zeros(3), 0.01, scale=-1.0),
    }
    for said, wrong in refused.items():
        with pytest.raises(InvalidInputError, match=said):
            wrong()
    assert f.memory()[0].tobytes() == kept


MODEL = Path(wbc.__file__).parent / "robot" / "models" / "hoap2_like.urdf"
SIDES = ("left", "right")


def gravity_on(robot: Robot, q: Array, feet: Iterable[str]) -> tuple[Array, Array]:
    """Return torques (nv - 6,) that hold a robot at rest, and the least wrenches (k, 6) of feet."""
    s = robot.snapshot(q)
    J = np.vstack([s.jacobian(robot.feet[foot].frame) for foot in feet])
    gravity = pin.computeGeneralizedGravity(robot.model, robot.model.createData(), q)
    wrenches = np.linalg.lstsq(J[:, :6].T, gravity[:6], rcond=None)[0]
    return (gravity - J.T @ wrenches)[6:], wrenches.reshape(-1, 6)


def observed(robot: Robot, q: Array, torque: Array) -> dict[str, Array]:
    """Return the wrenches that are found of a robot that rests for 0.2 s."""
    observer = MomentumObserver(robot)
    for _ in range(100):
        observer.update(q, np.zeros(robot.nv), torque, 0.002)
    return dict(observer.wrenches)


@pytest.mark.parametrize("name", ["hoap2_like", "g1_27"])
def test_wrenches_on_the_soles_are_found(name: str, robot_named, rng: np.random.Generator) -> None:
    """A robot that moves under torques and constant wrenches on its soles."""
    robot = robot_named(name)
    q, v = robot.posture(joints={"*knee*": 0.6}), 0.1 * rng.normal(size=robot.nv)
    data, dt = robot.model.createData(), 1e-4
    weight = robot.weight
    true = {
        "left": np.array((0.05, -0.03, 0.7, 0.0, 0.01, 0.002)) * weight,
        "right": np.array((-0.02, 0.04, 0.3, 0.01, 0.0, 0.0)) * weight,
    }
    observer = MomentumObserver(robot, bandwidth=400.0, base_trust=1.0)
    torque = 0.02 * weight * rng.normal(size=robot.nv - 6)
    observer.update(q, v, torque, 0.0)
    for _ in range(400):  # 40 ms, 16 time constants
        s = robot.snapshot(q, v)
        outside = sum(s.jacobian(robot.feet[foot].frame).T @ f for foot, f in true.items())
        motors = np.concatenate((np.zeros(6), torque))
        motors[6:] -= robot.damping * v[6:]
        a = pin.aba(robot.model, data, q, v, motors + outside)
        v = v + dt * a
        q = robot.integrate(q, v, dt)
        observer.update(q, v, torque, dt)
    # The lag of 2.5 ms times what J' f changes by meanwhile, and what damping gives: 3 %.
    for foot, f in true.items():
        assert np.allclose(observer.wrenches[foot][:3], f[:3], atol=0.04 * weight), foot
    assert np.allclose(observer.residual, outside, atol=0.03 * np.abs(outside).max())
    kept = observer.memory()
    observer.update(q, v, torque, dt)
    observer.restore(kept)
    assert observer.memory().tobytes() == kept.tobytes()
    observer.reset()
    assert not observer.residual.any()


@pytest.mark.parametrize("name", ["hoap2_like", "g1_27"])
def test_a_foot_in_the_air_bears_nothing(name: str, robot_named: Callable[[str], Robot]) -> None:
    """Of a robot at rest on its right foot: a HOAP's left one was said to bear 27 % of it."""
    robot = robot_named(name)
    q = robot.posture(joints={"*knee*": 0.6})
    torque, (wrench,) = gravity_on(robot, q, ("right",))
    found = observed(robot, q, torque)
    assert abs(found["left"][2]) < 0.12 * robot.weight
    assert found["right"][2] == pytest.approx(wrench[2], abs=0.12 * robot.weight)


def test_springs_bear_no_foot(hoap2: Robot, rng: np.random.Generator) -> None:
    """Knees on springs, bent: 40 N m of theirs were taken for forces on the soles."""
    spring = Spring(50.0, (0.0, 0.0), 0.0)
    robot = copy.copy(hoap2)
    knees = [name for name in robot.joint_names if "knee" in name]
    object.__setattr__(robot, "passive", PassiveForces(dict.fromkeys(knees, spring)))
    q, zero = robot.posture(joints={"*knee*": 0.8}), np.zeros(robot.nv)
    needed, wrenches = gravity_on(robot, q, SIDES)
    for name in knees:
        needed[robot.joint_index(name) - 6] += 50.0 * 0.8
    estimator, estimate = StateEstimator(robot), None
    for k in range(400):
        rate, force = 1e-4 * rng.normal(size=(2, 3))
        imu = ImuReading("imu", rate, force + (0.0, 0.0, 9.81))
        estimate = estimator.update(Measurement(0.002 * k, q[7:], zero[6:], needed, (imu,)))
    assert estimate is not None
    for found in (observed(robot, q, needed), estimate.forces):
        for foot, wrench in zip(SIDES, wrenches, strict=True):
            assert found[foot][2] == pytest.approx(wrench[2], abs=0.05 * robot.weight)
    held = standing_torque(robot.snapshot(q), [foot.frame for foot in robot.feet.values()])
    assert held == pytest.approx(needed, abs=1e-9)


def test_gears_bear_no_foot(tmp_path: Path) -> None:
    """Hips that gears couple to knees, as loops do: moments on soles were a fifth off.

    A biped whose knees are driven by four-bars felt feet wrongly in two of five ticks of a walk.
    """
    text = MODEL.read_text()
    for side in SIDES:
        at = text.index("<axis", text.index(f'<joint name="{side}_hip_pitch"'))
        text = f'{text[:at]}<mimic joint="{side}_knee_pitch" multiplier="-0.5"/>{text[at:]}'
    (tmp_path / "geared.urdf").write_text(text)
    robot = Robot.load(tmp_path / "geared.urdf")
    q = robot.posture(joints={"*knee*": 0.8, "*ankle_pitch": -0.4})
    needed, wrenches = gravity_on(robot, q, SIDES)
    for side in SIDES:
        hip, knee = (robot.joint_index(f"{side}_{one}_pitch") - 6 for one in ("hip", "knee"))
        needed[knee] += -0.5 * needed[hip]
        needed[hip] = 0.0
    found = observed(robot, q, needed)
    for foot, wrench in zip(SIDES, wrenches, strict=True):
        off = found[foot] - wrench
        assert np.abs(off[:3]).max() < 0.002 * robot.weight
        assert np.abs(off[3:]).max() < 1e-3  # N m
