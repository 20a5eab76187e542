"""The model that MuJoCo has is the robot: oracle is Pinocchio, at random states."""

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import load, random_state
from tests.simulation.accelerations import mass_and_bias
from tests.simulation.idle import idle
from wbc.errors import ModelError
from wbc.robot import Robot, robot_names
from wbc.simulation import Plant, Terrain
from wbc.simulation.mismatch import principal_inertia


@pytest.mark.parametrize("name", [*robot_names(), "mixed_joints"])
def test_mass_matrix_and_bias_are_pinocchios(name: str, rng: np.random.Generator) -> None:
    robot = load(name)
    plant = Plant(robot, shapes=False)
    for _ in range(10):
        q, v = random_state(robot, rng)
        plant.reset(q, v)
        s = robot.snapshot(q, v)
        for found, own in zip(mass_and_bias(plant, q, v), (s.mass_matrix, s.bias), strict=True):
            np.testing.assert_allclose(found, own, rtol=0.0, atol=1e-12 * np.abs(own).max())


def test_armature_damping_and_dry_friction_are_the_models() -> None:
    mine = Robot.load("hoap2_like", armature=0.003, damping={"*_hand": 0.1}, friction=0.02)
    for robot in (load("talos"), load("icub"), mine):  # TALOS has friction in its file
        plant = Plant(robot, shapes=False)
        at = [plant.model.joint(joint).dofadr[0] for joint in robot.joint_names]
        np.testing.assert_array_equal(plant.model.dof_armature[at], robot.armature)
        np.testing.assert_array_equal(plant.model.dof_damping[at], robot.damping)
        np.testing.assert_array_equal(plant.model.dof_frictionloss[at], robot.friction)
    assert load("talos").damping.any() and load("talos").friction.any()


def test_ranges_are_the_robots(humanoid: Robot) -> None:
    plant = Plant(humanoid, shapes=False)
    for k, name in enumerate(humanoid.joint_names):
        joint = plant.model.joint(name)
        expected = humanoid.limits.lower[k], humanoid.limits.upper[k]
        np.testing.assert_array_equal(joint.range, expected)
        assert plant.model.jnt_limited[joint.id]


def test_icub_as_its_file_is_cannot_be_simulated() -> None:
    with pytest.raises(ModelError, match=r"neck_yaw .* armature"):
        Plant(Robot.load("icub", armature=0.0))


def test_principal_axes_are_a_rotation(rng: np.random.Generator) -> None:
    for _ in range(10):
        body = pin.Inertia.Random()
        mass, com, R, moments = principal_inertia(body)
        assert mass == body.mass and (com == body.lever).all()
        assert np.linalg.det(R) == pytest.approx(1.0)
        np.testing.assert_allclose(R @ np.diag(moments) @ R.T, body.inertia, atol=1e-14)


def test_a_robot_without_collision_shapes_has_a_note() -> None:
    mixed = load("mixed_joints")
    (note,) = Plant(mixed, shapes=False).notes
    assert "no feet" in note
    notes = Plant(mixed).notes
    assert any("no collision shapes" in note for note in notes)
    assert Plant(load("g1")).notes == ()


def test_a_time_constant_that_mujoco_does_not_take_is_told(hoap2: Robot) -> None:
    """MuJoCo's contacts are no stiffer than two steps of the physics; nothing was said."""
    soft, stiff = (Plant(hoap2, terrain=Terrain(time_constant=one)) for one in (0.002, 1e-4))
    assert soft.notes == ()
    assert stiff.notes == (
        "the ground's contacts have a time constant of 0.002 s, twice physics_dt, as MuJoCo allows"
        " no less; not 0.0001",
    )
    for plant in (soft, stiff):
        idle(plant, 20)
    np.testing.assert_array_equal(soft.state()[0], stiff.state()[0])
