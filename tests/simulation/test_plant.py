"""A robot in MuJoCo against mechanics and against itself; without MuJoCo: what to install."""

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from tests.conftest import load, random_state
from tests.simulation.accelerations import acceleration_from_mujoco
from tests.simulation.idle import idle, in_the_air
from wbc.controllers import TorqueController
from wbc.errors import InvalidInputError, UnknownNameError, WbcError
from wbc.robot import Robot
from wbc.simulation import Plant, Sensors, SimulationError, Step, Terrain
from wbc.simulation.engine import check_state
from wbc.tasks import PostureTask

GRAVITY = np.array([0.0, 0.0, -9.81])


def holding(plant: Plant, q: np.ndarray, time: float) -> None:
    """Keep the posture on both feet by inverse dynamics with the least forces on the soles."""
    robot = plant.robot
    frames = [foot.frame for foot in robot.feet.values()]
    for _ in range(round(time / plant.dt)):
        s = plant.snapshot()
        a = -400.0 * robot.difference(q, s.q) - 40.0 * s.v
        J = np.concatenate([s.jacobian(frame) for frame in frames])
        drift = np.concatenate([s.drift(frame) for frame in frames])
        a -= np.linalg.pinv(J) @ (J @ a + drift + 40.0 * J @ s.v)  # the soles come to rest
        total = s.mass_matrix @ a + s.bias
        f = np.linalg.pinv(J[:, :6].T) @ total[:6]
        plant.step((total - J.T @ f)[6:])


def test_flight_keeps_momentum_and_obeys_gravity(humanoid: Robot, rng: np.random.Generator) -> None:
    """No torque acts on the whole: p = p0 + m g t and k = k0, whatever the joints do."""
    plant = Plant(humanoid, shapes=False)
    q, v = random_state(humanoid, rng)
    q[2] = 50.0
    start = humanoid.snapshot(q, 0.3 * v)
    plant.reset(q, 0.3 * v)
    for _ in range(25):
        plant.step(0.1 * rng.normal(size=humanoid.nv - 6))
    now = plant.snapshot()
    fallen = humanoid.mass * GRAVITY * plant.time
    size = np.abs(start.momentum).max()
    # semi-implicit Euler: linear momentum to rounding of M's factorisation, angular to O(dt)
    np.testing.assert_allclose(now.momentum[:3], start.momentum[:3] + fallen, atol=2e-3 * size)
    np.testing.assert_allclose(now.momentum[3:], start.momentum[3:], atol=2e-3 * size)


@pytest.mark.parametrize("name", ["g1", "hoap2_like"])
def test_standing_the_feet_carry_the_weight_under_the_com(name: str) -> None:
    humanoid = load(name)
    plant = Plant(humanoid)
    q = humanoid.posture("standing")
    plant.reset(q)
    holding(plant, q, 0.5)
    total = sum(plant.contact_forces.values())
    com = plant.snapshot().com
    # what is left of the fall onto the ground by 0.1 mm is damped by exp(-10)
    assert total[2] == pytest.approx(9.81 * humanoid.mass, rel=1e-3)
    assert plant.cop is not None
    np.testing.assert_allclose(plant.cop[:2], com[:2], atol=1e-3)
    assert -2e-4 < plant.cop[2] < 0.0  # soles sink in a little
    assert set(plant.contact_forces) == {foot.frame for foot in humanoid.feet.values()}
    assert not plant.touching()


def test_wrenches_on_the_soles_and_the_cop_are_those_of_the_motion() -> None:
    """Newton and Euler for the whole robot, by Pinocchio, from MuJoCo's accelerations."""
    robot = load("g1")
    plant = Plant(robot)
    q = robot.posture("standing")
    plant.reset(q, 0.1 * np.random.default_rng(3).normal(size=robot.nv))
    idle(plant, 5)
    q, v = plant.state()
    plant.model.opt.tolerance = 0.0  # the solver's forces are otherwise right to 1e-7 of these
    mujoco.mj_forward(plant.model, plant.data)
    plant._contacts = None  # read anew
    s = robot.snapshot(q, v)
    qacc = acceleration_from_mujoco(plant.states, q, v, plant.data.qacc)
    free = s.mass_matrix @ qacc + s.bias  # without torques only the ground acts
    wrenches = plant.contact_forces
    from_feet = sum(s.jacobian(frame).T @ wrench for frame, wrench in wrenches.items())
    size = np.abs(free[:6]).max()
    assert size > 10.0 and plant.touching() == ()
    np.testing.assert_allclose(free, from_feet, atol=1e-8 * size)
    # on level ground the CoP is where the whole moment has no horizontal part, at its height
    total = sum(wrenches.values())[:3]
    moment = sum(w[3:] + np.cross(s.position(f) - plant.cop, w[:3]) for f, w in wrenches.items())
    spread = np.ptp(plant.contacts.points[:, 2])  # the points are not at one height exactly
    assert np.abs(moment[:2]).max() < 2.0 * spread * np.linalg.norm(total) + 1e-9


@pytest.mark.parametrize("profile", ["rectangular", "half_sine"])
@pytest.mark.parametrize("duration", [0.1, 0.0333])  # the second is no multiple of a step
def test_a_push_changes_the_momentum_by_its_impulse(profile: str, duration: float) -> None:
    plant = in_the_air(load("hoap2_like"))
    given = {"duration": duration, "profile": profile, "start": 0.0105}
    push = plant.push("base", [3.0, -2.0, 1.0], "com", **given)
    factor = 1.0 if profile == "rectangular" else 2.0 / np.pi
    np.testing.assert_allclose(push.impulse, push.force * duration * factor, rtol=1e-12)
    idle(plant, 70)
    assert not plant.pushes
    expected = push.impulse + plant.robot.mass * GRAVITY * plant.time
    found = plant.snapshot().momentum[:3]
    np.testing.assert_allclose(found, expected, atol=2e-4 * np.abs(expected).max())


def test_what_begins_now_may_be_told_by_the_clock() -> None:
    """The time is a sum of steps: 0.01 was refused, as "0.01 s is over; it is 0.01 s"."""
    plant = Plant(load("hoap2_like"))
    idle(plant, 5)
    assert plant.time > 0.01
    push = plant.push("base", [1.0, 0.0, 0.0], start=0.01)
    wrench = plant.apply("base", np.ones(6), start=0.01)
    assert push.start == wrench.start == plant.time
    for act, size in ((plant.push, 3), (plant.apply, 6)):
        with pytest.raises(InvalidInputError, match=r"start: 0\.005 s is over; it is 0\.01 s"):
            act("base", np.ones(size), start=0.005)


@pytest.mark.parametrize("also", ["push", "latency"])
def test_forces_that_a_user_gives_mujoco_act_beside_pushes_and_delays(also: str) -> None:
    """A push, a wrench or a latency removed them, in silence."""
    robot, ends = load("hoap2_like"), list[np.ndarray]()
    q = robot.posture("standing")
    q[2] = 30.0
    for sensors in (Sensors(), Sensors(latency=0.002 * (also == "latency"))):
        plant = Plant(robot, sensors=sensors, gravity=(0.0, 0.0, 0.0))
        plant.reset(q)
        plant.data.xfrc_applied[1] = 3.0, 2.0, 1.0, 0.1, 0.2, 0.3
        if also == "push" and ends:
            plant.push("base", (0.0, 0.0, 0.0), duration=0.03)
        for _ in range(30):
            plant.step(np.zeros(robot.nv - 6))
        ends.append(np.concatenate(plant.state()))
    np.testing.assert_array_equal(*ends)
    assert np.linalg.norm(ends[0][robot.nq :]) > 0.01


def test_a_push_beside_the_com_turns_the_robot() -> None:
    plant = in_the_air(load("hoap2_like"))
    point, s = np.array([0.0, 0.05, 0.02]), plant.snapshot()
    push = plant.push("left_hand", [0.2, 0.0, 0.12], point, duration=0.002)
    arm = s.position("left_hand") + s.rotation("left_hand") @ point - s.com
    idle(plant)
    expected = np.cross(arm, push.impulse)
    found = plant.snapshot().momentum[3:]
    np.testing.assert_allclose(found, expected, atol=0.005 * np.abs(expected).max())  # it moves


@pytest.mark.slow
def test_same_input_same_bits(rng: np.random.Generator) -> None:
    robot = load("g1")
    plant, ends = Plant(robot), []
    torques = rng.normal(size=(40, robot.nv - 6))
    for one in (plant, plant, Plant(robot)):
        one.reset(robot.posture("standing"))
        one.push("pelvis", [50.0, 0.0, 0.0], duration=0.05)
        for torque in torques:
            one.step(torque)
        ends.append(np.concatenate((*one.state(), one.contacts.forces.ravel())))
    assert ends[0].tobytes() == ends[1].tobytes() == ends[2].tobytes()


def test_a_fallen_robot_lies_on_the_ground() -> None:
    robot = load("hoap2_like")
    plant = Plant(robot)
    plant.reset(robot.posture("standing"), np.eye(robot.nv)[0] * 1.0)
    for _ in range(1000):
        plant.step(-0.01 * plant.state()[1][6:])
    s = plant.snapshot()
    assert 0.0 < s.com[2] < 0.5 * robot.snapshot(robot.posture("standing")).com[2]
    assert plant.touching()
    total = plant.contacts.forces.sum(axis=0)
    assert total[2] == pytest.approx(9.81 * robot.mass, rel=0.2)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("sensors", Sensors(delay=0.002), "sensors cannot be assigned; make another Plant"),
        ("dt", 0.01, "dt cannot be assigned; make another Plant"),
        ("terrain", Terrain(), "terrain cannot be assigned; make another Plant"),
        ("pushs", [], "no attribute 'pushs'; did you mean 'pushes'"),
    ],
)
def test_attributes_assigned_later_that_would_do_nothing_are_refused(name, value, told) -> None:
    with pytest.raises(InvalidInputError, match=told):
        setattr(Plant(load("hoap2_like")), name, value)


def test_a_blow_up_is_an_error_with_time_and_joint() -> None:
    plant = Plant(load("hoap2_like"), saturate=False)
    torque = np.zeros(plant.robot.nv - 6)
    torque[plant.robot.joint_index("left_elbow_pitch") - 6] = 1e12
    with pytest.raises(SimulationError, match="blew up") as caught:
        for _ in range(5):
            plant.step(torque)
    assert caught.value.joint in (*plant.robot.joint_names, "base")
    assert caught.value.time == pytest.approx(plant.time, abs=0.003)
    plant.reset(plant.robot.posture("standing"))  # and it can begin again
    idle(plant)


def test_torques_are_held_to_the_effort_limits() -> None:
    robot = load("g1")
    plants = Plant(robot), Plant(robot)
    limit = robot.limits.effort
    for _ in range(3):
        plants[0].step(10.0 * limit)
        plants[1].step(limit)
    assert plants[0].state()[1].tobytes() == plants[1].state()[1].tobytes()
    assert (plants[0].saturated == 3).all() and not plants[1].saturated.any()


def locked() -> Robot:
    """A robot that stands as a block: all joints but the first are locked."""
    robot = load("hoap2_like")
    values = robot.limits.joint_positions(robot.posture())
    names = robot.joint_names
    return Robot.load("hoap2_like", locked=dict(zip(names[1:], values[1:], strict=True)))


@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_on_a_slope_it_slides_as_a_block_does(friction: float) -> None:
    """Joints are locked: at rest up to tan(a) = mu, then with g (sin a - mu cos a)."""
    robot = locked()
    rise, time = 0.2, 0.3
    angle = np.arctan(rise)
    c, s = np.cos(angle), np.sin(angle)
    plant = Plant(robot, terrain=Terrain(friction=friction, slope=(0.0, rise)), shapes=False)
    q = robot.posture("standing")
    q[:3] = q[0], c * q[1] - s * q[2], s * q[1] + c * q[2]
    q[3:7] = np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)
    plant.reset(q)
    idle(plant, round(time / plant.dt))
    moved = robot.difference(q, plant.state()[0])[:3]  # in its own axes: y is up the slope
    slides = max(0.0, 9.81 * (s - friction * c))
    assert abs(moved[0]) < 1e-3 and abs(moved[2]) < 1e-3
    assert moved[1] == pytest.approx(-0.5 * slides * time**2, rel=0.02, abs=5e-4)
    f = plant.contacts
    along = np.linalg.norm(f.forces - f.normal_forces[:, None] * f.normals, axis=1)
    assert (along <= friction * f.normal_forces * (1 + 1e-6) + 1e-9).all()


def test_a_step_carries_the_foot_that_stands_on_it() -> None:
    robot = load("hoap2_like")
    q = robot.posture("standing")
    q[2] += 0.05
    step = Step(centre=[0.0, 0.0, 0.05], size=[0.5, 0.5, 0.05], yaw=0.3)
    plant = Plant(robot, terrain=Terrain(steps=(step,)))
    plant.reset(q)
    holding(plant, q, 0.2)
    assert plant.cop is not None and plant.cop[2] == pytest.approx(0.05, abs=1e-3)
    assert sum(plant.contact_forces.values())[2] == pytest.approx(9.81 * robot.mass, rel=0.02)


@pytest.mark.slow
def test_an_arm_stops_at_the_body_if_links_may_meet() -> None:
    """An arm that is driven across the body goes through it by default, as it says."""
    robot, ends = load("g1"), []
    joint = robot.joint_index("left_shoulder_roll_joint") - 6
    names = [(f"left_{part}_joint", 0.0) for part in ("shoulder_pitch", "elbow")]
    for option in (False, True):
        plant = Plant(robot, self_collision=option)
        q = robot.posture("standing", dict(names))
        q[2] += 5.0
        plant.reset(q)
        for _ in range(150):
            torque = -1.0 * plant.state()[1][6:]
            torque[joint] -= 12.0
            plant.step(np.clip(torque, -20.0, 20.0))
        ends.append(robot.limits.joint_positions(plant.state()[0])[joint])
        assert not plant.contacts.points.size and not plant.touching()
        assert bool(plant.self_contacts()) == option
        if option:
            assert any("left" in a + b for a, b in plant.self_contacts())
    assert ends[1] > ends[0] + 0.3


@pytest.mark.slow
def test_links_that_may_meet_do_not_when_standing() -> None:
    for name in ("g1", "hoap2_like"):
        robot = load(name)
        plant = Plant(robot, self_collision=True)
        assert plant.self_contacts() == () == plant.touching()
        # internal forces are no forces of the ground
        idle(plant)
        assert len(plant.contacts.points) == sum(len(f.polygon) for f in robot.feet.values())


def test_a_step_edge_below_the_soles_is_felt() -> None:
    """Feet that stand half over an edge press on it."""
    robot = locked()
    q = robot.posture("standing")
    start = robot.snapshot(q)
    sole = start.position("left_sole")[0] + robot.feet["left"].polygon[:, 0]
    edge = start.com[0] + 0.5 * (sole.max() - start.com[0])  # between CoM and toes
    q[2] += 0.1
    step = Step(centre=[edge - 0.5, 0.0, 0.1], size=[1.0, 1.0, 0.1])
    plant = Plant(robot, terrain=Terrain(steps=(step,)), shapes=False)
    plant.reset(q)
    idle(plant, 300)
    points = plant.contacts.points
    np.testing.assert_allclose(points[:, 2], 0.1, atol=1e-3)
    assert points[:, 0].max() == pytest.approx(edge, abs=1e-3)  # not only at the heels
    assert plant.contacts.normal_forces.sum() == pytest.approx(9.81 * robot.mass, rel=1e-2)
    # now the CoM is beyond the edge: it tips over it, about the edge, and does not sink through
    step = Step(centre=[start.com[0] - 0.02 - 0.5, 0.0, 0.1], size=[1.0, 1.0, 0.1])
    plant = Plant(robot, terrain=Terrain(steps=(step,)), shapes=False)
    plant.reset(q)
    idle(plant, 150)
    tipped = plant.body_rotation("base")[2] @ robot.snapshot(q).rotation("base")[2]
    assert 0.5 < tipped < 0.999
    assert plant.contacts.points[:, 0].max() == pytest.approx(start.com[0] - 0.02, abs=0.01)


def test_mistakes_are_typed() -> None:
    robot = load("hoap2_like")
    plant, zero = Plant(robot), np.zeros(robot.nv - 6)
    posture = PostureTask(robot, robot.posture("standing"))
    tick = TorqueController(robot, [posture], contacts=()).step(plant.snapshot())
    mistakes: list[tuple[Callable[[], object], type[WbcError], str]] = [
        (lambda: plant.step(zero[1:]), InvalidInputError, "torque"),
        (lambda: plant.step(zero * np.nan), InvalidInputError, "torque"),
        (lambda: plant.step(tick), InvalidInputError, r"plant\.step\(tick\.torque\)"),
        (lambda: plant.step(zero, dt=0.0025), InvalidInputError, "multiple of physics_dt"),
        (lambda: Plant(robot, dt=0.0005), InvalidInputError, "multiple"),
        (lambda: plant.push("left_hnad", [1, 0, 0]), UnknownNameError, "frame"),
        (lambda: plant.push("base", [1, 0, 0], profile="halfsine"), UnknownNameError, "half_sine"),
        (lambda: plant.push("base", [1, 0, 0], "centre"), UnknownNameError, "com"),
        (lambda: plant.push("base", [1, 0, 0], start=-1.0), InvalidInputError, "start"),
        (lambda: Plant("g1"), InvalidInputError, "robot"),
        (lambda: Plant(robot, friction=0.5, terrain=Terrain()), InvalidInputError, "not both"),
        (lambda: Plant(robot, friction=-0.5), InvalidInputError, "friction"),
    ]
    for mistake, error, said in mistakes:
        with pytest.raises(error, match=said):
            mistake()


@pytest.mark.parametrize(
    "how", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))]
)
def test_a_copy_goes_on_by_itself(how: Callable[[Plant], Plant]) -> None:
    """From where the plant was, with its noise, delay and push; which may go on before it."""
    robot = load("hoap2_like")
    plant = Plant(robot, sensors=Sensors(position_noise=1e-3, delay=0.002))
    plant.push("base", (5.0, 0.0, 0.0), duration=0.1)
    idle(plant, 5)
    other = how(plant)
    assert how is not copy.copy or other.snapshot().robot is robot
    idle(plant, 10)
    assert other.time == pytest.approx(0.01)
    idle(other, 10)
    np.testing.assert_array_equal(other.snapshot().q, plant.snapshot().q)
    np.testing.assert_array_equal(other.contacts.forces, plant.contacts.forces)


CODE = """
import sys
sys.modules["mujoco"] = None
import wbc.simulation
robot = wbc.Robot.load("hoap2_like")
try:
    wbc.simulation.Plant(robot)
except wbc.WbcError as error:
    print(type(error).__name__, error)
"""


@pytest.mark.slow
def test_without_mujoco() -> None:
    command, here = [sys.executable, "-c", CODE], Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=here)
    assert done.stdout.startswith("MissingPackageError simulation needs mujoco")
    assert "pip install 'wbc[sim]'" in done.stdout


@pytest.mark.parametrize(
    ("kind", "words", "joint"),
    [
        ("mjWARN_BADQPOS", "position of 'knee'", "knee"),
        ("mjWARN_BADQACC", "acceleration of 'base'", "base"),
        ("mjWARN_CONTACTFULL", "too many contacts", None),
        ("mjWARN_INERTIA", "mjWARN_INERTIA", None),
    ],
)
def test_warnings_are_errors(kind: str, words: str, joint: str | None) -> None:
    index = int(getattr(mujoco.mjtWarning, kind))
    numbers, infos = np.zeros(8, dtype=int), np.zeros(8, dtype=int)
    numbers[index], infos[index] = 2, 1
    warning = SimpleNamespace(number=numbers, lastinfo=infos)
    data = SimpleNamespace(time=0.25, qpos=np.zeros(2), qvel=np.zeros(2), warning=warning)
    with pytest.raises(SimulationError, match=words) as caught:
        check_state(mujoco, data, ("base", "knee"), ("base", "base"))
    assert (caught.value.time, caught.value.joint) == (0.25, joint)
    numbers[:] = 0
    check_state(mujoco, data, (), ())


def test_a_blow_up_leaves_no_log_file_and_prints_nothing(tmp_path, monkeypatch, capfd) -> None:
    monkeypatch.chdir(tmp_path)
    before = mujoco.get_mju_user_warning()
    plant = Plant(Robot.load("hoap2_like"), saturate=False)
    with pytest.raises(SimulationError):
        for _ in range(9):
            plant.step(np.full(plant.robot.nv - 6, 1e13))
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr() == ("", "")
    assert mujoco.get_mju_user_warning() == before
