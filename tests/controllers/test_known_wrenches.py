"""Known external wrenches at the torque level, by Pinocchio's recursion and in MuJoCo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import wbc
from wbc.controllers.saved_tick import SavedTick
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Robot
from wbc.simulation import Plant, simulate

WRENCH = np.array([3.0, -2.0, -20.0, 0.5, 0.2, -0.3])


def standing(robot: Robot, **options: float) -> wbc.TorqueController:
    here = robot.snapshot(robot.posture())
    tasks = [
        wbc.ComTask(robot, here.com),
        wbc.OrientationTask(robot, "base", here.rotation("base")),
        wbc.PostureTask(robot, here.q),
    ]
    return wbc.TorqueController(robot, tasks, contacts=wbc.support(here, "double"), **options)


@pytest.mark.parametrize("delay", [0.0, 0.004])
def test_torques_bear_them(hoap2: Robot, delay: float, tmp_path: Path) -> None:
    """Oracle: RNEA with the wrench as an external force of its joint; exact to rounding."""
    controller = standing(hoap2, delay=delay)
    rng = np.random.default_rng(5)
    q = hoap2.integrate(hoap2.posture(), 0.02 * rng.normal(size=hoap2.nv), 1.0)
    v = 0.05 * rng.normal(size=hoap2.nv)
    wrenches = {"left_hand": 0.2 * WRENCH, "base": -WRENCH}
    free = controller.step(hoap2.snapshot(q, v))
    measured = hoap2.snapshot(q, v)
    here = controller.predicted(measured)  # the same without a delay
    tick = controller.step(measured, wrenches)
    assert not tick.policy and set(tick.wrenches) == set(wrenches)
    assert np.abs(tick.torque - free.torque).max() > 0.1
    # A file holds them: asked again, the same bits.
    tick.save(tmp_path / "tick.wbc")
    replay = SavedTick.load(tmp_path / "tick.wbc").replay()
    assert replay.same, replay.differences
    model = hoap2.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, here.q)
    external = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
    for frame, wrench in {**wrenches, **tick.forces}.items():
        index = hoap2.frame_id(frame)
        joint, where = model.frames[index].parentJoint, data.oMf[index].translation
        at_origin = pin.SE3(np.eye(3), where).act(pin.Force(wrench))
        external[joint] += data.oMi[joint].actInv(at_origin)
    needed = pin.rnea(model, data, here.q, here.v, tick.acceleration, external)
    needed[6:] += hoap2.damping * (here.v + controller.dt * tick.acceleration)[6:]
    np.testing.assert_allclose(needed[:6], 0.0, atol=1e-6 * hoap2.weight)
    np.testing.assert_allclose(needed[6:], tick.torque, atol=1e-8 * hoap2.weight)
    # Of this tick only.
    assert not controller.step(hoap2.snapshot(q, v)).wrenches


def test_what_no_wrench_is_is_refused_by_name(hoap2: Robot) -> None:
    controller, here = standing(hoap2), hoap2.snapshot(hoap2.posture())
    before = controller.step(here)
    with pytest.raises(UnknownNameError, match="did you mean 'left_hand'"):
        controller.step(here, {"left_hnd": WRENCH})
    with pytest.raises(InvalidInputError, match=r"wrenches\['left_hand'\]"):
        controller.step(here, {"left_hand": WRENCH[:3]})
    with pytest.raises(InvalidInputError, match=r"wrenches\['left_hand'\]"):
        controller.step(here, {"left_hand": WRENCH * np.nan})
    with pytest.raises(InvalidInputError, match=r"expected \{name: value\}"):
        controller.step(here, [WRENCH])
    # A refused one leaves nothing behind.
    np.testing.assert_allclose(controller.step(here).torque, before.torque, atol=1e-9)


def test_the_plant_applies_them_where_they_are_said_to_act(hoap2: Robot) -> None:
    """Oracle: M a + bias = J' w of the snapshot, in the air, before the first step of physics."""
    plant = Plant(hoap2, shapes=False, dt=1e-3, physics_dt=1e-3)
    q = hoap2.posture()
    q[2] += 5.0
    plant.reset(q)
    plant.apply("left_hand", 0.1 * WRENCH, duration=0.01)
    assert plant.known_wrenches()["left_hand"] == pytest.approx(0.1 * WRENCH)
    s = plant.snapshot()
    plant.step(np.zeros(hoap2.nv - 6))
    # Implicit in the joints' damping, as the physics is; armature is in the mass matrix.
    M = s.mass_matrix + 1e-3 * np.diag(np.concatenate((np.zeros(6), hoap2.damping)))
    expected = 1e-3 * np.linalg.solve(M, s.jacobian("left_hand").T @ (0.1 * WRENCH) - s.bias)
    np.testing.assert_allclose(plant.state()[1], expected, atol=1e-4 * abs(expected).max())
    for _ in range(10):
        plant.step(np.zeros(hoap2.nv - 6))
    assert not plant.wrenches and not plant.known_wrenches() and not plant.applied


@pytest.mark.slow
def test_a_g1_told_of_20_newtons_at_its_wrist_does_not_sag(g1: Robot) -> None:
    """Told: within 2 mm for three seconds. Not told: some 90 mm, by the gains of its tasks."""
    robot, hand, sag = g1, "left_wrist_yaw_link", {}
    place = robot.snapshot(robot.posture()).position(hand)
    for told in (True, False):
        plant = Plant(robot)
        plant.apply(hand, (0.0, 0.0, -20.0, 0.0, 0.0, 0.0), start=0.2, told=told)
        away = [
            float(np.linalg.norm(plant.snapshot().position(hand) - place))
            for _ in simulate(standing(robot), plant, 3.0)
        ]
        sag[told] = max(away)
    assert sag[True] < 2e-3 and sag[False] > 0.05
