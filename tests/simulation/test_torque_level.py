"""The torque level on a plant that is not its model: MuJoCo."""

import mujoco
import numpy as np
import pytest

import wbc
from tests.conftest import random_state
from tests.simulation.accelerations import acceleration_from_mujoco
from tests.standing import stack, torque_controller
from wbc.robot import Robot
from wbc.simulation import Plant, simulate


@pytest.mark.parametrize("mode", ["double", "right", "floating"])
def test_forward_dynamics_give_the_acceleration_of_the_tick(
    mode: str, humanoid: Robot, rng: np.random.Generator
) -> None:
    """Oracle: MuJoCo's accelerations under the tick's torques and contact forces."""
    robot = humanoid
    standing = robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))
    plant = Plant(robot, shapes=False)
    plant.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    plant.model.dof_damping[:] = 0.0  # the tick's is implicit, by the velocity at its end
    for _ in range(3):
        q, v = random_state(robot, rng)
        here = robot.snapshot(q, 0.3 * v)
        given = {"contacts": wbc.support(here, mode), "solver": "daqp"}
        tick = wbc.TorqueController(robot, stack(standing), **given).step(here)
        plant.reset(here.q, here.v)
        torque = tick.torque - robot.model.damping[6:] * tick.velocity[6:]
        plant.states.torques_to_mujoco(torque, plant.data.qfrc_applied)
        for frame, wrench in tick.forces.items():
            joint = robot.model.frames[robot.frame_id(frame)].parentJoint
            body = plant.model.body(f"body {joint}").id
            arm = here.position(frame) - plant.data.xipos[body]
            moment = wrench[3:] + np.cross(arm, wrench[:3])
            plant.data.xfrc_applied[body] += np.concatenate((wrench[:3], moment))
        mujoco.mj_forward(plant.model, plant.data)
        found = acceleration_from_mujoco(plant.states, here.q, here.v, plant.data.qacc)
        # A torque at its bound is clipped by what the solver leaves there, about 1e-8 of it.
        size = np.abs(tick.acceleration).max() + np.abs(tick.torque).max()
        np.testing.assert_allclose(found, tick.acceleration, atol=1e-8 * size)


@pytest.mark.slow
def test_every_humanoid_stands_without_a_gain(humanoid: Robot) -> None:
    """Default gains, weights and contacts; the ground is MuJoCo's."""
    robot = humanoid
    plant = Plant(robot)
    plant.reset(robot.posture("standing"))
    start = plant.snapshot()
    controller = torque_controller(start, limits=wbc.Limits(robot))
    for now in simulate(controller, plant, 0.5):
        assert now.tick.policy is None, now.tick.report()
    here, tick = plant.snapshot(), now.tick
    assert np.linalg.norm(here.com - start.com) < 1e-3
    for foot in robot.feet.values():
        assert np.linalg.norm(here.position(foot.frame) - start.position(foot.frame)) < 5e-4
    # Predicted and measured: the ground gives way by a tenth of a millimetre.
    assert tick.cop is not None and plant.cop is not None
    np.testing.assert_allclose(tick.cop, plant.cop, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seconds", "armature"), [("g1", 0.6, 0.003), ("g1", 0.35, 0.003), ("talos", 0.7, None)]
)
def test_a_crouch_into_the_ankles_limits_does_not_chatter(
    name: str, seconds: float, armature: float | None
) -> None:
    """The forces' total variation: one weight and back is 2, and 100 where limits chattered."""
    robot = wbc.Robot.load(name, **({} if armature is None else {"armature": armature}))
    plant = Plant(robot)
    start = robot.snapshot(robot.posture("standing"))
    com = wbc.ComTask(robot, start.com, weight=30.0, kp=100.0)
    tasks = [com, wbc.PostureTask(robot, start.q, weight=0.1)]
    given = {"contacts": wbc.support(start, "double"), "limits": wbc.Limits(robot)}
    controller = wbc.TorqueController(robot, tasks, **given, solver="daqp")
    down = np.array([0.0, 0.0, -0.35 * start.com[2]])
    forces, margins = [], []
    for k in range(round((seconds + 0.6) / controller.dt)):
        x = min(k * controller.dt / seconds, 1.0)
        way = np.polyval([6.0, -15.0, 10.0, 0.0, 0.0, 0.0], x)
        rate = np.polyval([30.0, -60.0, 30.0, 0.0, 0.0], x) / seconds
        com.set_target(start.com + way * down, rate=rate * down)
        here = robot.snapshot(*plant.state())
        tick = controller.step(here)
        assert tick.policy is None, tick.report()
        plant.step(tick.torque)
        forces.append(sum(force[2] for force in tick.forces.values()) / robot.weight)
        ankles = [k for k, joint in enumerate(robot.joint_names) if "ankle_pitch" in joint]
        ankles = ankles or [robot.joint_names.index(f"leg_{s}_5_joint") for s in ("left", "right")]
        margins.append((here.joint_positions - robot.limits.lower)[ankles].min())
    assert min(margins) < 1e-3, "the limit is what ends the crouch"
    assert np.abs(np.diff(forces)).sum() < 12.0
    assert max(forces) < 2.5
    assert here.com[2] > 0.55 * start.com[2]
