"""The model that MuJoCo has is the robot, its gears and given errors included: by Pinocchio."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import load, random_state
from tests.simulation.accelerations import mass_and_bias
from tests.simulation.idle import idle
from tests.urdf import geared_arm, limit
from wbc.errors import InvalidInputError, ModelError
from wbc.robot import Robot, robot_names
from wbc.simulation import ModelMismatch, Plant, Terrain
from wbc.simulation.mismatch import principal_inertia


def test_factors_and_shift(rng: np.random.Generator) -> None:
    robot = load("g1")
    mismatch = ModelMismatch(mass=1.1, inertia=0.8, com=[0.01, -0.02, 0.03])
    plant = Plant(robot, mismatch=mismatch, shapes=False)
    model = robot.model.copy()
    for j in range(1, model.njoints):
        body = robot.model.inertias[j]
        lever = body.lever + ([0.01, -0.02, 0.03] if j == 1 else np.zeros(3))
        model.inertias[j] = pin.Inertia(1.1 * body.mass, lever, 1.1 * 0.8 * body.inertia)
    for _ in range(3):
        q, v = random_state(robot, rng)
        plant.reset(q, v)
        M = pin.crba(model, model.createData(), q)
        M = np.triu(M) + np.triu(M, 1).T
        h = pin.nonLinearEffects(model, model.createData(), q, v)
        found = mass_and_bias(plant, q, v)
        np.testing.assert_allclose(found[0], M, atol=1e-12 * np.abs(M).max())
        np.testing.assert_allclose(found[1], h, atol=1e-12 * np.abs(h).max())


def test_spreads_are_within_bounds_and_follow_the_seed() -> None:
    robot = load("g1")
    masses = robot.model.inertias.tolist()
    plain = np.array([body.mass for body in masses][1:])

    def built(seed: int) -> Plant:
        mismatch = ModelMismatch(mass_spread=0.1, inertia_spread=0.2, com_spread=0.01, seed=seed)
        return Plant(robot, mismatch=mismatch, shapes=False)

    first, again, other = built(1), built(1), built(2)
    ids = [first.model.body(f"body {j}").id for j in range(1, robot.model.njoints)]
    factors = first.model.body_mass[ids] / plain
    assert factors.min() >= 0.9 and factors.max() <= 1.1 and np.ptp(factors) > 0.1
    levers = np.array([body.lever for body in masses][1:])
    shifts = first.model.body_ipos[ids] - levers
    assert np.abs(shifts).max() <= 0.01 and np.abs(shifts).max() > 0.005
    exact = Plant(robot, shapes=False)
    stretch = first.model.body_inertia[ids] / exact.model.body_inertia[ids] / factors[:, None]
    assert stretch.min() >= 0.8 - 1e-12 and stretch.max() <= 1.2 + 1e-12
    np.testing.assert_allclose(np.ptp(stretch, axis=1), 0.0, atol=1e-12)  # of a link as a whole
    assert first.model.body_mass.tobytes() == again.model.body_mass.tobytes()
    assert first.model.body_mass.tobytes() != other.model.body_mass.tobytes()


def test_the_friction_of_the_ground() -> None:
    robot = load("hoap2_like")
    plant = Plant(robot, terrain=Terrain(friction=0.5), mismatch=ModelMismatch(friction=0.6))
    assert plant.model.geom("ground").friction[0] == pytest.approx(0.3)


def test_options_are_plain_data() -> None:
    mismatch = pickle.loads(pickle.dumps(ModelMismatch(mass=1.1, seed=4)))
    assert (mismatch.mass, mismatch.seed) == (1.1, 4)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"mass": 0.0}, "mass"),
        ({"mass_spread": 1.0}, "mass_spread"),
        ({"com": [1.0, 2.0]}, "com"),
        ({"friction": -0.1}, "friction"),
        ({"seed": True}, "seed"),
    ],
)
def test_mistakes_are_typed(options: dict[str, object], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        ModelMismatch(**options)


@pytest.fixture
def arm() -> Robot:
    """Joints a, b and c, of which c follows b at -2 b + 0.1; the base is bolted."""
    return Robot.load(geared_arm("abc", at="0.02 0 0.1", limits=limit(2, 99, 9)))


def test_the_geared_tree_moves_as_lagrange_says(arm: Robot) -> None:
    """With v = G u the motion is G' (M G du/dt + h) = G' tau, at the first step."""
    assert arm.fixed_base and list(arm.couplings) == ["c"]
    plant = Plant(arm, dt=1e-3, shapes=False)
    G = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -2.0]])
    q = arm.posture("neutral", {"a": 0.3, "b": 0.4})
    u, torque = np.array([0.5, -0.3]), np.array([3.0, 1.0, -2.0])
    v = np.concatenate((np.zeros(6), G @ u))
    s = arm.snapshot(q, v)
    M, h = s.mass_matrix[6:, 6:], s.bias[6:]
    rate = np.linalg.solve(G.T @ M @ G, G.T @ (torque - h))
    plant.reset(q, v)
    plant.step(torque)
    found = (plant.state()[1][6:] - v[6:]) / 1e-3
    np.testing.assert_allclose(found, G @ rate, rtol=1e-3)  # 1e-4 of it is the gear's softness


def test_the_gear_holds_under_load(arm: Robot) -> None:
    plant = Plant(arm, shapes=False)
    plant.reset(arm.posture("neutral", {"a": 0.3, "b": 0.2}))
    worst = 0.0
    for k in range(500):
        q, v = plant.state()
        a, b, c = arm.limits.joint_positions(q)
        worst = max(worst, abs(c - (-2.0 * b + 0.1)))
        swing = 8.0 * np.sin(0.02 * k)
        plant.step(np.array([-30.0 * a, swing, 0.0]) - 2.0 * v[6:])
        assert abs(b) < 1.0
    assert worst < 1e-4  # rad


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
