"""A log is run again to the same bits; what the controller knows, and a robot measures."""

from collections import Counter, deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

pytest.importorskip("mujoco")

from tests.command import wbc_command
from wbc.errors import InvalidInputError
from wbc.estimation import ImuMount
from wbc.hardware.bus import BaseTruth, Command, Reading
from wbc.hardware.log_file import HardwareLog
from wbc.hardware.operator import Script
from wbc.hardware.real_time import Beat
from wbc.hardware.replay import replay_log
from wbc.hardware.robot_controller import (
    EstimateError,
    RobotController,
    SensorEstimator,
    TruthEstimator,
)
from wbc.hardware.robot_side import RobotSettings
from wbc.hardware.setup import loop_of, simulated_robot
from wbc.hardware.unitree.profiles import profile_named
from wbc.hardware.worker import Job, run_job
from wbc.problem import load_problem
from wbc.robot import Robot
from wbc.rotations import exp_rotation, rotation_from

UP, RUN = 4.6, 0.6  # s until it is up, and of running
DT = 0.002
PROBLEM = Path(__file__).parents[2] / "problems" / "walk_g1.yaml"


class Wire:
    """Both ends of a bus, in one process."""

    def __init__(self) -> None:
        self.dropped = Counter[str]()
        self._readings, self._commands = deque[Reading](maxlen=1), deque[Command](maxlen=1)

    def read(self) -> Reading | None:
        return self._readings.pop() if self._readings else None

    def receive(self) -> Command | None:
        return self._commands.pop() if self._commands else None

    def send(self, reading: Reading) -> None:
        self._readings.append(reading)

    def write(self, command: Command) -> None:
        self._commands.append(command)

    def close(self) -> None: ...


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A G1 stands up and begins to walk, on estimated state, in simulated time."""
    problem, profile = load_problem(PROBLEM), profile_named("unitree_g1")
    wire, path = Wire(), tmp_path_factory.mktemp("log") / "hardware.npz"
    side = simulated_robot(problem.parts.robot, profile, wire, RobotSettings())
    loop = loop_of(problem, profile, lambda: wire, Script(10.0), log=path, keep=20.0,
                   forked=False, priority=0)  # fmt: skip
    for k in range(round((UP + RUN) / DT)):
        side.step(k * DT)
        side.step(k * DT)
        loop.cycle(Beat(k * DT, 0.0, 0))
    loop._shut_down()
    return path


def changed(path: Path, to: Path, change: dict[str, object]) -> Path:
    with np.load(path) as file:
        content = {name: file[name] for name in file.files}
    for name, edit in change.items():
        if edit is None:
            del content[name]
        else:
            content[name] = edit(content[name]) if callable(edit) else edit
    np.savez(to, **content)
    return to


@pytest.mark.slow
def test_a_log_is_run_again_to_the_same_bits_and_a_changed_one_is_not(log: Path, tmp_path) -> None:
    again = replay_log(log)
    assert again.same and again.compared > 0.9 * RUN / DT, str(again)
    assert wbc_command("replay", log).exit_code == 0

    def bumped(position: np.ndarray) -> np.ndarray:
        position[-100] = np.nextafter(position[-100], np.inf)
        return position

    other = changed(log, tmp_path / "other.npz", {"position": bumped})
    found = replay_log(other)
    assert not found.same and len(found.differences) <= 2 * 4 * 100
    assert wbc_command("replay", other).exit_code == 3


@pytest.mark.slow
def test_a_log_that_does_not_reach_back_says_how_more_is_kept(log: Path, tmp_path: Path) -> None:
    with np.load(log) as file:
        late = {name: file[name][-200:] for name in file.files if file[name].ndim}
    with pytest.raises(InvalidInputError, match="--keep"):
        replay_log(changed(log, tmp_path / "late.npz", late))
    idle = changed(log, tmp_path / "idle.npz", {"asked": lambda asked: np.nan * asked})
    with pytest.raises(InvalidInputError, match="did not stand up"):
        replay_log(idle)


@pytest.mark.slow
def test_a_log_opens_as_a_run(log: Path, tmp_path: Path) -> None:
    run = HardwareLog.load(log).as_run()
    assert run.history.com[-1, 2] > 0.5
    assert set(run.history.phase) == {"standing up", "running"}
    for command, name in (("report", "log.html"), ("export", "log.mcap")):
        told = wbc_command(command, log, "-o", tmp_path / name)
        assert told.exit_code == 0, told.output
    page = (tmp_path / "log.html").read_text()
    assert "armed by hand" in page and "Normal force" not in page


@pytest.mark.slow
def test_events_have_the_times_of_the_rows(log: Path, tmp_path: Path) -> None:
    """They had the machine's clock, where plots and the slider begin with the log."""
    armed = {"time": lambda time: time + 1e3, "events": np.array(["1002.5 damping: armed by hand"])}
    run = HardwareLog.load(changed(log, tmp_path / "later.npz", armed)).as_run()
    assert run.summary["events"][0] == ("2.5000 s", "damping: armed by hand")
    broken = changed(log, tmp_path / "broken.npz", {"events": np.array(["armed by hand"])})
    with pytest.raises(InvalidInputError, match="'events': expected a time, got 'armed'"):
        HardwareLog.load(broken).as_run()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"made_of": np.array("{}")}, "does not say what ran"),
        ({"q": None}, "'q': expected shape"),
        ({"mode": lambda mode: mode + 100}, "damaged"),
        ({"events": None}, "not a log"),
        ({"time": lambda time: time[::-1]}, "'time': must increase"),
    ],
)
def test_a_damaged_log_is_refused(change, told, log, tmp_path) -> None:
    with pytest.raises(InvalidInputError, match=told):
        HardwareLog.load(changed(log, tmp_path / "damaged.npz", change))


PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_load_of_the_feet_is_that_of_the_joints_torques(share: float) -> None:
    """By Pinocchio: recursive Newton-Euler at rest, forces on the soles; straps bear the rest."""
    problem = load_problem(PROBLEMS / "walk_g1.yaml")
    supervisor, robot, q = problem.supervisor_on_robot(), problem.parts.robot, problem.parts.start
    still = np.zeros(robot.nv)
    push = pin.StdVec_Force(robot.model.njoints, pin.Force.Zero())
    for foot in robot.feet.values():
        frame = robot.model.frames[robot.frame_id(foot.frame)]
        up = robot.snapshot(q).rotation(foot.frame).T @ (0.0, 0.0, 0.5 * share * robot.weight)
        push[frame.parentJoint] = frame.placement.act(pin.Force(up, np.array((0.3, -0.2, 0.1))))
    torque = pin.rnea(robot.model, robot.model.createData(), q, still, still, push)[6:]
    n, zero = len(torque), np.zeros(3)
    truth = BaseTruth(q[:7], still[:6])
    reading = Reading(
        0, 0.0, q[7:], np.zeros(n), torque, np.zeros(n), np.zeros(4), zero, zero, base_truth=truth
    )
    controller = RobotController(
        lambda: supervisor, TruthEstimator(robot), q, np.ones(n), np.ones(n)
    )
    # Not exactly: the moments on the soles are others than those of the least wrenches.
    assert controller.observe(reading).load == pytest.approx(share, abs=0.1)


def test_a_controller_that_had_no_estimate_to_begin_with_begins_at_the_next() -> None:
    """It commanded in the estimate's world, a metre from where the problem begins."""
    problem = load_problem(PROBLEMS / "stand_hoap2_like.yaml")
    robot, q = problem.parts.robot, problem.parts.start
    n, zero = robot.nv - 6, np.zeros(3)
    pose = q[:7] + (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0)
    rest = np.zeros(n)
    blind = Reading(0, 0.0, q[7:], rest, rest, rest, np.zeros(4), zero, zero)
    seen = replace(blind, sequence=1, time=0.002, base_truth=BaseTruth(pose, np.zeros(6)))
    controller = RobotController(
        problem.supervisor_on_robot, TruthEstimator(robot), q, np.ones(n), np.ones(n)
    )
    assert run_job(controller, Job(blind, True, True, False)).no_estimate
    answer = run_job(controller, Job(seen, False, True, False)).answer
    assert answer is not None and answer.q == pytest.approx(q, abs=1e-9)


def test_an_imu_may_be_mounted_anyhow_and_what_is_rejected_is_told(hoap2, rng) -> None:
    turned, n = exp_rotation(np.array((0.4, -1.2, 2.0))), hoap2.nv - 6
    mounted = SensorEstimator(hoap2, ImuMount("chest", "torso", (0.02, 0.0, 0.1), turned))
    q, zero = hoap2.posture(), np.zeros(n)

    def reading(k: int, jump: float = 0.0) -> Reading:
        spin, force = 1e-4 * rng.normal(size=(2, 3)) + ((0.0,) * 3, turned.T @ (0.0, 0.0, 9.81))
        joints = q[7:] + jump * (np.arange(n) == 3)
        return Reading(k, k * 0.002, joints, zero, zero, zero, np.zeros(4), spin, force)

    for k in range(250):
        with pytest.raises(EstimateError):
            mounted.update(reading(k))
    found, _ = mounted.update(reading(250))
    assert rotation_from(found[3:7]) == pytest.approx(np.eye(3), abs=1e-3)
    last = reading(251, jump=0.5)
    for _ in range(2):  # where a controller begins
        mounted.update(last)
    told = f"estimate, once: joint {hoap2.joint_names[3]}: position jumped; held"
    assert mounted.notes == (told,)


class Listener:
    """Keeps what is sent."""

    def __init__(self) -> None:
        self.dropped = Counter[str]()
        self.readings = list[Reading]()

    def receive(self) -> Command | None:
        return None

    def send(self, reading: Reading) -> None:
        self.readings.append(reading)

    def close(self) -> None: ...


def test_the_imu_measures_where_it_is(g1: Robot) -> None:
    """Its readings integrate to the motion of its frame, by Pinocchio, of a robot that is thrown.

    Readings at the base, 0.095 m aside, end 5 mm off after 0.2 s.
    """
    listener, profile = Listener(), profile_named("unitree_g1")
    assert profile.mount(g1).frame == "imu_in_pelvis"
    quiet = dict.fromkeys(
        ("velocity_noise", "gyroscope_noise", "accelerometer_noise", "orientation_noise"), 0.0
    )
    settings = RobotSettings(0.001, encoder=1e-12, truth=True, gantry=False, **quiet)
    side = simulated_robot(g1, profile, listener, settings, lifted=0.5)
    side.push(0.0, "pelvis", (400.0, 300.0, 200.0), 0.05)
    for k in range(200):
        side.step(0.001 * k)
    readings, gravity, positions, rotations = listener.readings, (0.0, 0.0, -9.81), [], []
    for one in readings:
        assert one.base_truth is not None
        here = g1.snapshot(np.concatenate((one.base_truth.pose, one.position)))
        positions.append(here.position("imu_in_pelvis"))
        rotations.append(here.rotation("imu_in_pelvis"))
    dt = np.diff([one.time for one in readings])
    velocity = (positions[1] - positions[0]) / dt[0]
    place, R = positions[1], rotations[1]
    for one, step in zip(readings[2:], dt[1:], strict=True):
        R = R @ exp_rotation(step * one.angular_velocity)
        velocity = velocity + step * (rotation_from(one.quaternion) @ one.specific_force + gravity)
        place = place + step * velocity
    np.testing.assert_allclose(place, positions[-1], atol=5e-5)  # Euler's error
    np.testing.assert_allclose(R, rotations[-1], atol=1e-2)
