"""Devices of a simulated robot, and a robot that is controlled by what they tell."""

import copy
import pickle
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import wbc
from tests import urdf
from tests.simulation.idle import idle
from tests.standing import standing, torque_controller
from wbc.errors import InvalidInputError, ProblemFileError
from wbc.estimation import ContactFilter, EstimatorSettings
from wbc.gait import Walker
from wbc.problem import load_problem
from wbc.robot import Robot
from wbc.rotations import exp_rotation, rotation_from
from wbc.simulation import (
    Devices,
    Encoders,
    FootSwitches,
    Imu,
    MessageBus,
    MotorTorques,
    Plant,
    SensedPlant,
    Sensors,
    simulate,
)
from wbc.simulation.sensed_plant import EstimateErrors
from wbc.simulation.sensors_reading import Sensing

TURNED = exp_rotation(np.array((0.3, -0.5, 1.2)))
EXACT = {f"{of}_{what}": 0.0 for of in ("gyroscope", "accelerometer") for what in ("noise", "bias")}
EXACT |= {"gyroscope_walk": 0.0, "accelerometer_walk": 0.0}


def test_an_exact_imu_integrates_to_where_the_plant_goes(hoap2: Robot) -> None:
    """In free fall, turning: 0.2 s of readings from a turned mount off the base's origin."""
    imu = Imu(position=(0.05, -0.02, 0.1), rotation=TURNED, **EXACT)
    plant = Plant(hoap2, shapes=False)
    q, v = hoap2.posture(), np.zeros(hoap2.nv)
    q[2] += 5.0
    v[:6] = 0.5, -0.2, 1.0, 1.0, 2.0, -1.5
    plant.reset(q, v)
    sensing = Sensing(plant, Devices(imus=(imu,)))
    f = ContactFilter(0)

    def truth() -> tuple[np.ndarray, np.ndarray]:
        q, _ = plant.state()
        R = rotation_from(q[3:7])
        arm = np.array(imu.position)
        return R @ TURNED, q[:3] + R @ arm

    R, p = truth()
    own = v[:3] + np.cross(v[3:6], imu.position)
    f.reset(R, p, rotation_from(q[3:7]) @ own)
    sensing.read(plant)
    for _ in range(100):
        plant.step(np.zeros(hoap2.nv - 6))
        sensing.read(plant)
    for message in sensing.received(plant.time):
        for reading in message.imus:
            f.predict(reading.angular_velocity, reading.specific_force, 0.002)
    R, p = truth()
    # Means of 2 ms turned to their middle, and the physics' own steps: of second order.
    assert np.allclose(f.rotation, R, atol=1e-3)
    assert np.allclose(f.position, p, atol=2e-3)


def test_devices_measure_as_they_are_said_to(hoap2: Robot) -> None:
    bus = MessageBus(delay=0.002, jitter=0.004, loss=0.2)
    encoders = Encoders(resolution=0.01, delay=0.003, rates=True, rate_noise=0.0)
    devices = Devices(
        imus=(Imu(rate=250.0),), encoders=encoders, torques=None, feet=FootSwitches(), bus=bus
    )
    plant = Plant(hoap2)
    sensing = Sensing(plant, devices)
    torque, sent, came = np.zeros(hoap2.nv - 6), dict[float, np.ndarray](), []
    for _ in range(200):
        sensing.read(plant)
        sent[round(plant.time, 6)] = plant.state()[0][7:]
        came += [(m, plant.time) for m in sensing.received(plant.time)]
        plant.step(torque)
    found = [m for m, _ in came]
    assert 20 <= sensing.lost <= 60  # 40 of 200 on the mean; a deviation is 5.7
    assert all(0.002 - 1e-9 <= at - m.time <= 0.008 + 1e-9 for m, at in came)
    assert any(b.time < a.time for a, b in pairwise(found))
    assert sum(len(m.imus) for m in found) == pytest.approx(0.5 * len(found), abs=15)
    assert all(m.torques is None and m.velocities is not None for m in found)
    assert any(m.contacts == {"left": True, "right": True} for m in found[5:])
    for m in found[10:]:
        assert np.allclose(m.positions, 0.01 * np.round(m.positions / 0.01))
        then = 0.5 * (sent[round(m.time - 0.002, 6)] + sent[round(m.time - 0.004, 6)])
        assert np.abs(m.positions - then).max() <= 0.005 + 1e-9
    for wrong in (lambda: Imu(rate=300.0).period(0.002), lambda: Devices(imus=(Imu(), Imu()))):
        with pytest.raises(InvalidInputError):
            wrong()
    with pytest.raises(InvalidInputError, match="bus, loss"):
        MessageBus(loss=1.0)


def test_late_encoders_of_a_joint_that_goes_round_and_round_are_between_two_readings() -> None:
    """Between 3.13 and -3.13 rad, one encoder said 0."""
    joint = urdf.joint("j", "root", "wheel", kind="continuous")
    robot = Robot.load(urdf.robot("spinning", urdf.link("root"), urdf.link("wheel"), joint))
    plant, v = Plant(robot, gravity=(0.0, 0.0, 0.0)), np.zeros(robot.nv)
    v[6:] = 2.5
    plant.reset(robot.posture("neutral"), v)
    sensing = Sensing(plant, Devices(encoders=Encoders(resolution=0.0, delay=0.003)))
    said = []
    for _ in range(900):
        sensing.read(plant)
        said += [m.positions[0] for m in sensing.received(plant.time)]
        plant.step(np.zeros(1))
    assert max(said) > 3.1 and min(said) < -3.1
    np.testing.assert_allclose(np.diff(np.unwrap(said))[2:], 2.5 * plant.dt, atol=1e-9)


def test_motor_currents_tell_the_torques_that_act(hoap2: Robot) -> None:
    """With a latency they told those that were commanded, and not there yet."""
    plant = Plant(hoap2, sensors=Sensors(latency=0.004))
    sensing = Sensing(plant, Devices(torques=MotorTorques(noise=0.0, friction=0.0, gain=0.0)))
    for k in range(5):
        plant.step(np.full(hoap2.nv - 6, 0.01 * (k + 1)))
        sensing.read(plant)
        (m,) = sensing.received(plant.time)
        np.testing.assert_array_equal(m.torques, 0.01 * max(k - 1, 1))


@pytest.mark.parametrize(
    ("imu", "said"),
    [
        ({"gyroscope_bias": 0.5}, r"messages, and no .* stand still; IMU 'imu' says 0\.\d+ rad/s"),
        ({"rate": 5.0}, r"there is no reading of IMU 'imu'"),
        ({"most_force": 5.0}, r"'imu'; IMU 'imu': specific force beyond its range of 4\.995; n"),
    ],
)
def test_what_keeps_an_estimator_from_beginning_is_said(imu, said: str, hoap2: Robot) -> None:
    """Of all of them it was said that messages were lost."""
    devices = Devices(imus=(Imu(**imu),))  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match=said):
        SensedPlant(hoap2, devices=devices)


@pytest.mark.slow
def test_a_robot_stands_on_what_it_feels_and_to_the_same_bits(hoap2: Robot) -> None:
    imus = (Imu(frame="torso", rotation=TURNED, position=(0.0, 0.02, 0.05)),)
    ends = []
    for _ in range(2):
        controller = torque_controller(standing(hoap2), limits=wbc.Limits(hoap2))
        plant = SensedPlant(hoap2, devices=Devices(imus=imus, seed=3))
        plant.reset(hoap2.posture())
        plant.push("base", (6.0, 0.0, 0.0), start=0.1, duration=0.1)
        *_, last = simulate(controller, plant, 0.5)
        assert last.verdict.stood
        ends.append(plant.state()[0].tobytes())
    assert ends[0] == ends[1]
    assert plant.errors.velocity < 0.02
    assert plant.errors.tilt < np.deg2rad(0.5)
    assert plant.notes[-1].startswith("estimate") or "estimated state" in plant.notes[-1]
    forces = plant.felt_forces
    assert sum(f[2] for f in forces.values()) == pytest.approx(hoap2.weight, rel=0.15)
    with pytest.raises(InvalidInputError, match="plant, sensors"):
        SensedPlant(hoap2, sensors=Sensors(position_noise=1e-3))


@pytest.mark.parametrize("how", [copy.copy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_goes_on_by_itself(hoap2: Robot, how: Callable[[SensedPlant], SensedPlant]) -> None:
    """It could not be copied, as other plants can: TypeError, of a struct of the core."""
    plant = SensedPlant(hoap2, devices=Devices(seed=3))
    idle(plant, 5)
    other = how(plant)
    ends = []
    for one in (plant, other):
        idle(one, 10)
        measured = one.measure()
        assert measured is not None
        ends.append(measured[0].tobytes() + measured[1].tobytes())
    assert ends[0] == ends[1]


def test_a_refused_reset_changes_nothing(hoap2: Robot) -> None:
    """The robot was put at the start, and went on with estimates of where it had been."""
    plant = SensedPlant(hoap2)
    plant.step(np.zeros(hoap2.nv - 6))
    with pytest.raises(InvalidInputError, match="begins at rest"):
        plant.reset(hoap2.posture("standing"), np.ones(hoap2.nv))
    assert plant.time == plant.dt


def test_an_error_of_the_height_is_told(hoap2: Robot) -> None:
    """It was in no line: "position by 2 mm" of a base that was told to be 19 mm lower."""
    plant = SensedPlant(hoap2)
    plant.step(np.zeros(hoap2.nv - 6))
    q, v = plant.state()
    estimate = plant.estimate
    assert estimate is not None
    errors = EstimateErrors()
    errors.add(estimate, np.array([*estimate.q[:2], estimate.q[2] + 0.019, *q[3:]]), v)
    assert errors.rise == pytest.approx(-0.019)
    assert str(errors).endswith("position by 0 mm, height by -19 mm")


def problem(folder: Path, simulation: str) -> Path:
    path = folder / "walk.yaml"
    path.write_text(
        "robot: hoap2_like\ngait:\n  commands: [{at: 0.1, vx: 0.1}]\nsimulation:\n" + simulation
    )
    return path


def test_problem_files_describe_devices_and_name_mistakes(tmp_path: Path) -> None:
    text = (
        "  duration: 1\n  estimate: true\n  devices:\n    imus: [{frame: %s, gyroscope_bias: 0}]\n"
    )
    more = "    feet: {}\n    torques: null\n    bus: {delay: 0.004}\n    seed: 4\n"
    plant = load_problem(problem(tmp_path, text % "torso" + more)).plant()
    assert isinstance(plant, SensedPlant)
    assert plant.devices.torques is None and plant.devices.feet is not None
    assert plant.devices.bus.delay == 0.004 and plant.devices.imus[0].gyroscope_bias == 0.0
    for wrong, told in (
        (text % "trso", "unknown frame 'trso'"),
        ("  duration: 1\n  devices: {seed: 1}\n", "add estimate: true"),
        (text % "torso" + "  sensors: {position_noise: 0.1}\n", "sensors.position_noise: adds"),
        (text % "torso" + "    bus: {delya: 1}\n", "did you mean 'delay'"),
        (text % "torso" + "    estimator: {history: -1}\n", "history"),
        (text % "torso" + "  gravity: 1.62\n", "gravity: the estimator counts on 9.81"),
    ):
        with pytest.raises(ProblemFileError, match=told):
            load_problem(problem(tmp_path, wrong))


@pytest.mark.slow
def test_a_g1_walks_on_what_it_feels(robot_named: Callable[[str], Robot]) -> None:
    """At 0.5 m/s for 4 s; messages late by 2 to 4 ms, one in a hundred lost."""
    robot = Robot.load("g1", armature=0.003)
    bus = MessageBus(delay=0.002, jitter=0.002, loss=0.01)
    plant = SensedPlant(robot, devices=Devices(bus=bus, seed=7), settings=EstimatorSettings())
    plant.reset(robot.posture())
    walker = Walker(robot)
    for k in range(2000):
        if k == 100:
            walker.command(0.5)
        state = plant.measure()
        assert state is not None
        plant.step(walker.step(robot.snapshot(*state), plant.felt_forces).torque)
    assert plant.com[2] > 0.5
    assert walker.steps >= 6
    assert plant.errors.velocity < 0.05
    assert plant.errors.tilt < np.deg2rad(0.4)
    assert plant.errors.drift < 0.02 * plant.errors.way
