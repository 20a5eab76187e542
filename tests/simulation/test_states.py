"""States in MuJoCo's coordinates, and J' q' of its contacts: by finite differences."""

import mujoco
import numpy as np
import pytest

import wbc
from tests.conftest import load, random_state
from tests.simulation.accelerations import acceleration_from_mujoco, acceleration_to_mujoco
from tests.simulation.idle import idle
from wbc.errors import InvalidInputError
from wbc.robot import Robot, robot_names
from wbc.simulation import Plant, Terrain
from wbc.simulation.states import ContactDrift
from wbc.validate import Array


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
