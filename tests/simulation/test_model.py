"""MuJoCo's model is the robot: by Pinocchio; states in its coordinates, surfaces of terrains."""

import json

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import wbc
from tests.conftest import load, random_state
from tests.simulation.accelerations import (
    acceleration_from_mujoco,
    acceleration_to_mujoco,
    mass_and_bias,
)
from tests.simulation.idle import idle
from tests.urdf import collision, geared_arm, joint, limit, link
from tests.urdf import robot as urdf
from wbc.errors import InvalidInputError, ModelError
from wbc.robot import Robot, robot_names
from wbc.simulation import ModelMismatch, Plant, Step, Terrain
from wbc.simulation.states import ContactDrift
from wbc.simulation.terrain import LEVEL
from wbc.validate import Array


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


# A board, turned by a quarter: 0.4 m along the world's x, 0.2 m along y.
BOARD = Step(centre=(1.0, 0.5, 0.3), size=(0.2, 0.4, 0.1), yaw=0.5 * np.pi, friction=0.5)
SLOPED = Terrain(friction=0.4, slope=(0.1, -0.2), steps=(BOARD,), time_constant=0.02, drift=True)


def test_the_surface_is_the_plane_and_the_boards_on_it() -> None:
    points = np.array(((0.0, 0.0), (2.0, 1.0), (1.19, 0.59), (1.21, 0.5), (1.0, 0.61)))
    surface = SLOPED.surface(points)
    np.testing.assert_array_equal(surface[:, :2], points)
    on_plane = 0.1 * points[:, 0] - 0.2 * points[:, 1]
    wanted = np.where([False, False, True, False, False], 0.3, on_plane)
    np.testing.assert_allclose(surface[:, 2], wanted, rtol=0, atol=1e-15)
    above = np.column_stack((points, np.full(5, 7.0)))  # a height that points have does not matter
    np.testing.assert_array_equal(SLOPED.surface(above), surface)


def test_upright_tells_how_far_a_point_is_above_the_plane() -> None:
    point = np.array((2.0, 1.0, 5.0))
    assert SLOPED.upright @ point == pytest.approx(5.0)  # 0.2 - 0.2 below it
    foot = point - (SLOPED.upright @ point) * np.array((0.0, 0.0, 1.0))
    assert SLOPED.normal @ foot == pytest.approx(0.0, abs=1e-15)
    assert np.linalg.norm(SLOPED.normal) == pytest.approx(1.0)


@pytest.mark.parametrize("terrain", [LEVEL, SLOPED])
def test_plain_data_come_back(terrain: Terrain) -> None:
    data = json.loads(json.dumps(terrain.to_data()))
    found = Terrain.from_data(data)
    assert found.to_data() == terrain.to_data() == data
    assert len(found.steps) == len(terrain.steps)
    for mine, other in zip(found.steps, terrain.steps, strict=True):
        np.testing.assert_array_equal(mine.centre, other.centre)
        np.testing.assert_array_equal(mine.size, other.size)
        assert (mine.yaw, mine.friction) == (other.yaw, other.friction)


def test_a_tilted_board_is_where_mujoco_has_it(hoap2: Robot) -> None:
    """By rays from above, on and beside the board."""
    import mujoco

    board = Step((0.6, -0.2, 0.15), (0.5, 0.3, 0.1), yaw=0.4, slope=(0.2, -0.3))
    terrain = Terrain(steps=(board,))
    plant = Plant(hoap2, terrain=terrain)
    model, data = plant.model, plant.data
    mujoco.mj_forward(model, data)
    points = np.random.default_rng(0).uniform((0.2, -0.6), (1.0, 0.2), size=(200, 2))
    group, hit = np.ones(6, dtype=np.uint8), np.zeros(1, dtype=np.int32)
    found = []
    for x, y in points.tolist():
        start, down = np.array((x, y, 2.0)), np.array((0.0, 0.0, -1.0))
        found.append(2.0 - mujoco.mj_ray(model, data, start, down, group, 1, -1, hit))
    on = terrain.height(points) > 0.0
    assert 30 < on.sum() < 170
    # A side of the board that leans out hides a little of the ground, which height() does not.
    same = np.isclose(terrain.height(points), found, atol=1e-9)
    assert same[on].all() and same.mean() > 0.9


@pytest.fixture
def odd() -> Plant:
    return Plant(load("mixed_joints"))  # continuous joints, slides, odd axes


@pytest.mark.parametrize("name", [*robot_names(), "mixed_joints"])
def test_round_trip(name: str, rng: np.random.Generator) -> None:
    plant = Plant(load(name), shapes=False)
    for _ in range(20):
        q, v = random_state(plant.robot, rng)
        back = plant.states.from_mujoco(*plant.states.to_mujoco(q, v))
        np.testing.assert_allclose(back[0], q, atol=1e-14)
        np.testing.assert_allclose(back[1], v, atol=1e-14)


def test_the_velocity_is_the_rate_of_the_configuration(odd: Plant, rng) -> None:
    """MuJoCo's own integration of ``qvel`` against Pinocchio's of ``v``: they differ by h^2."""
    h = 1e-6
    for _ in range(5):
        q, v = random_state(odd.robot, rng)
        qpos, qvel = odd.states.to_mujoco(q, v)
        mujoco.mj_integratePos(odd.model, qpos, qvel, h)
        moved, _ = odd.states.from_mujoco(qpos, qvel)
        step = odd.robot.difference(q, moved) / h
        np.testing.assert_allclose(step, v, atol=1e-4)  # h |v|^2, and rounding 1e-16 / h


def test_the_acceleration_is_the_rate_of_the_velocity(odd: Plant, rng: np.random.Generator) -> None:
    h = 1e-6
    states, robot = odd.states, odd.robot
    for _ in range(5):
        q, v = random_state(robot, rng)
        a = rng.normal(size=robot.nv)
        before = states.to_mujoco(robot.integrate(q, v, -h), v - h * a)[1]
        after = states.to_mujoco(robot.integrate(q, v, h), v + h * a)[1]
        qacc = acceleration_to_mujoco(states, q, v, a)
        np.testing.assert_allclose((after - before) / (2 * h), qacc, atol=1e-7)
        np.testing.assert_allclose(acceleration_from_mujoco(states, q, v, qacc), a, atol=1e-12)


def test_a_fixed_base_stays_where_it_is_put() -> None:
    robot = Robot.load("hoap2_like", base="fixed", feet={})
    plant = Plant(robot, shapes=False)
    q = robot.posture("neutral", on_ground=False)
    q[:3] = 0.3, -0.2, 2.0
    q[3:7] = np.array([0.1, 0.2, 0.3, 0.9]) / np.sqrt(0.95)
    plant.reset(q)
    idle(plant, 20)
    end, v = plant.state()
    np.testing.assert_array_equal(end[:7], robot.check_configuration(q)[:7])
    assert not v[:6].any() and v[6:].any()
    body = plant.model.body("body 2").id  # carried by the base: it was put there too
    where = robot.snapshot(end).position(robot.model.names[2])
    mujoco.mj_kinematics(plant.model, plant.data)
    np.testing.assert_allclose(plant.data.xpos[body], where, atol=1e-12)
    with pytest.raises(InvalidInputError, match=r"base .* is fixed"):
        plant.reset(q, np.ones(robot.nv))


def folding(robot: wbc.Robot, sink: float) -> tuple[Array, Array]:
    """Return a stance with bent knees, and the velocity of least norm at which it sinks [m/s].

    Its feet are at rest: the rates are those of the joints, by the feet's Jacobians.
    """
    q = robot.posture("standing")
    s = robot.snapshot(q)
    feet = np.vstack([s.jacobian(foot.frame) for foot in robot.feet.values()])
    base = np.eye(6, robot.nv)
    wanted = np.concatenate((np.zeros(len(feet)), (0.0, 0.0, -sink, 0.0, 0.0, 0.0)))
    v = np.linalg.lstsq(np.vstack((feet, base)), wanted, rcond=None)[0]
    return q, v


def test_drift_is_mujocos_own_derivative() -> None:
    """By mj_jacDot, at points of contact of a robot that moves in all ways."""
    g1 = load("g1")
    plant = Plant(g1, terrain=Terrain(slope=(0.05, -0.1)))
    rng = np.random.default_rng(3)
    q = g1.posture("standing")
    q[2] -= 0.01
    plant.reset(q, rng.standard_normal(g1.nv))
    model, data = plant.model, plant.data
    mujoco.mj_step1(model, data)
    assert data.ncon >= 4
    found = ContactDrift(model).at(data)
    for contact, drift in zip(data.contact, found, strict=True):
        derivative = np.zeros((3, model.nv))
        body = model.geom_bodyid[contact.geom2]
        mujoco.mj_jacDot(model, data, derivative, None, contact.pos, body)
        expected = contact.frame.reshape(3, 3) @ derivative @ data.qvel
        assert model.geom_bodyid[contact.geom1] == 0
        np.testing.assert_allclose(drift, expected, atol=1e-10 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize("drift", [False, True])
def test_a_foot_rests_while_legs_fold(drift: bool) -> None:
    """Without J' q' the ground lets it go at that acceleration; with it, it stays."""
    g1 = load("g1")
    plant = Plant(g1, terrain=Terrain(drift=drift))
    q, v = folding(g1, 1.5)
    q[2] -= 1e-4  # pressed, so that all corners touch
    plant.reset(q, v)
    # Legs press down with three times the weight, so that no corner would have to be pulled.
    start, push = g1.snapshot(q, v), np.array((0.0, 0.0, 1.5 * g1.weight, 0.0, 0.0, 0.0))
    pressed = sum(start.jacobian(one.frame).T @ push for one in g1.feet.values())
    plant.step((start.bias - pressed)[6:], plant.physics_dt)
    after = g1.snapshot(*plant.state())
    foot = next(iter(g1.feet.values())).frame
    vertical = after.jacobian(foot)[2] @ after.v
    own = start.drift(foot)[2] * plant.physics_dt
    assert own > 0.01
    if drift:
        assert abs(vertical) < 0.1 * own
    else:
        assert vertical == pytest.approx(own, rel=0.2)


@pytest.mark.parametrize("shape", ['sphere radius="0"', 'capsule radius="0" length="0.1"'])
def test_points_and_lines_touch_the_ground(shape: str) -> None:
    """MuJoCo takes no ball without a size, as public files have for contact points."""
    tip = link("tip", collision(shape, "0 0 -.1001", "1.5708 0 0"))
    robot = Robot.load(urdf("arm", link("root"), joint("j", "root", "tip", at="0 0 .1"), tip))
    assert Plant(robot).touched() == {"tip": "ground"}
