"""Forces from outside, by torques: against the equations of motion that Pinocchio integrates."""

import copy
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import wbc
from wbc.estimation import ImuReading, Measurement, MomentumObserver, StateEstimator
from wbc.hardware.postures import standing_torque
from wbc.robot import Robot
from wbc.robot.passive import PassiveForces, Spring
from wbc.validate import Array

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
