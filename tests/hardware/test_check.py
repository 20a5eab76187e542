"""Robots whose bus, sensors and joints are wrong in one way each: what a check says of them.

They hang, their joints follow commands of their own motor, and time is a number that sleeps add to.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.command import wbc_command
from wbc.errors import WbcError
from wbc.hardware import check, real_time
from wbc.hardware.bus import Command, Reading
from wbc.hardware.check import CheckFinding, CheckGains, listen, move_joints
from wbc.hardware.setup import Where, safety_of
from wbc.hardware.unitree import profile_named
from wbc.hardware.unitree.profiles import by_pattern
from wbc.robot import Robot
from wbc.rotations import quaternion_from, rotation_from

PERIOD, FOLLOW = 0.002, 0.02  # s between readings, and of the joints' motion
ELBOW, SHOULDER, WRIST = "left_elbow_joint", "left_shoulder_roll_joint", "right_wrist_roll_joint"
KNEE, OTHER_KNEE = "left_knee_joint", "right_knee_joint"
DRAGGED, HIP = "right_elbow_joint", "right_hip_yaw_joint"
Change = Callable[[Reading], Reading]


class HangingRobot:
    """Joints that go where their motors are told, without physics; readings by the clock."""

    def __init__(self, robot: Robot, clock: dict[str, float]) -> None:
        n = len(robot.joint_names)
        self.dropped: Counter[str] = Counter()
        self.position = robot.postures["standing"][7:].copy()
        self.goal, self.clock, self.sent = self.position.copy(), clock, 0
        self.sign, self.motor, self.loose = np.ones(n), np.arange(n), np.ones(n)
        self.change: Change = lambda reading: reading
        self.command = Command.damping(np.zeros(n), enabled=False)
        self.random = np.random.default_rng(3)

    def read(self) -> Reading | None:
        due = int(self.clock["now"] / PERIOD)
        if due == self.sent:
            return None
        share = 1.0 - np.exp(-(due - self.sent) * PERIOD / FOLLOW)
        speed = share * (self.goal - self.position) / PERIOD
        self.position = self.position + share * (self.goal - self.position)
        self.sent, n, noise = due, self.position.size, self.random.normal
        zero, warm = np.zeros(n), np.full(n, 30.0)
        joints = self.position + 1e-5 * noise(size=n), speed + 1e-3 * noise(size=n)
        still, up = 1e-3 * noise(size=3), np.array((0.0, 0.0, 9.81)) + 1e-2 * noise(size=3)
        level = np.array((0.0, 0.0, 0.0, 1.0))
        return self.change(Reading(due, due * PERIOD, *joints, zero, warm, level, still, up))

    def write(self, command: Command) -> None:
        """Begin to go where motors are told, from where joints are."""
        self.command = command
        if command.enabled and command.kp.any():
            if not hasattr(self, "origin"):
                self.origin = self.position.copy()
            moved = (self.sign * (command.position - self.origin))[self.motor]
            self.goal = self.origin + self.loose * moved

    def close(self) -> None: ...


@pytest.fixture
def hanging(g1: Robot, monkeypatch: pytest.MonkeyPatch) -> HangingRobot:
    clock = {"now": 100.0}

    def sleep(seconds: float) -> None:
        clock["now"] += seconds

    def sleep_until(deadline: float) -> None:
        clock["now"] = max(clock["now"], deadline)

    monkeypatch.setattr(check.time, "sleep", sleep)
    monkeypatch.setattr(check, "now", lambda: clock["now"])
    monkeypatch.setattr(real_time, "now", lambda: clock["now"])
    monkeypatch.setattr(real_time, "sleep_until", sleep_until)
    return HangingRobot(g1, clock)


def wrong(findings: list[CheckFinding]) -> dict[str, str]:
    return {one.what: one.seen for one in findings if not one.good}


def moved(g1: Robot, bus: HangingRobot) -> list[CheckFinding]:
    profile = profile_named("unitree_g1")
    gains = CheckGains(by_pattern(g1, profile.stiffness), by_pattern(g1, profile.holding))
    return move_joints(bus, g1, safety_of(g1, profile, PERIOD), gains)


@pytest.mark.slow
def test_a_robot_as_it_should_be_has_no_finding(g1: Robot, hanging: HangingRobot) -> None:
    assert not wrong(listen(hanging, g1))
    findings = moved(g1, hanging)
    assert not wrong(findings) and [one.what for one in findings] == list(g1.joint_names)
    assert hanging.command.is_passive  # it is left braking
    np.testing.assert_allclose(hanging.position, hanging.origin, atol=0.08)  # 2 degrees off stops


@pytest.mark.slow
def test_joints_that_are_wrong_in_one_way_each_are_told_apart(g1, hanging, monkeypatch) -> None:
    """By the command, which ends with an error."""
    names = (SHOULDER, ELBOW, WRIST, KNEE, OTHER_KNEE)
    roll, elbow, wrist, left, right = map(g1.joint_names.index, names)
    hanging.loose[roll], hanging.sign[elbow], hanging.loose[wrist] = 0.0, -1.0, 3.0
    hanging.motor[[left, right]] = right, left
    hanging.motor[g1.joint_names.index(DRAGGED)] = g1.joint_names.index(HIP)  # by its wires
    code, told = told_by(monkeypatch, hanging, g1, "--move", "--priority", "0")
    assert code != 0
    lines = (line.split(maxsplit=2) for line in told.splitlines())
    said = {line[1]: line[2] for line in lines if line[:1] == ["WRONG"]}
    assert said.keys() == {SHOULDER, ELBOW, WRIST, KNEE, OTHER_KNEE, DRAGGED, HIP}
    assert "blocked" in said[SHOULDER] and "blocked" in said[DRAGGED]
    assert "its sign is swapped" in said[ELBOW] and "3.0 times as far as told" in said[WRIST]
    assert f"{OTHER_KNEE} moved instead" in said[KNEE] and f"{DRAGGED} by" in said[HIP]


def tilted(reading: Reading) -> Reading:
    half = 0.5  # of 1 rad about x
    turned = np.array((np.sin(half), 0.0, 0.0, np.cos(half)))
    force = 9.81 * np.array((0.0, np.sin(2 * half), np.cos(2 * half)))
    return replace(reading, quaternion=turned, specific_force=force)


def upside_down(reading: Reading) -> Reading:
    """The cosine of its tilt is below -1, by rounding: the check ended in a ValueError."""
    half = (np.array((np.cos(a), np.sin(a), 0.0, 0.0)) for a in np.linspace(0.0, 3.0, 500))
    turns = next(one for one in half if rotation_from(one)[2, 2] < -1.0)
    return replace(reading, quaternion=turns, specific_force=-reading.specific_force)


def beyond(reading: Reading) -> Reading:
    position = reading.position.copy()
    position[3] = 2.95  # a knee, of at most 2.88
    return replace(reading, position=position)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (tilted, "upright"),
        (upside_down, "upright"),
        (beyond, "range"),
        (lambda one: replace(one, specific_force=one.specific_force / 9.81), "gravity"),
        (lambda one: replace(one, specific_force=-one.specific_force), "gravity"),
        (lambda one: replace(one, angular_velocity=one.angular_velocity + 0.2), "gyroscope"),
        (lambda one: replace(one, time=one.time * 5.0), "rate"),
    ],
)
def test_a_sensor_that_is_wrong_is_named(g1, hanging, change: Change, what: str) -> None:
    hanging.change = change
    assert what in wrong(listen(hanging, g1))


@pytest.mark.parametrize("heard", [0, 3])
def test_another_program_that_commands_is_told_of(heard: int, g1, hanging, monkeypatch) -> None:
    """Two controllers on one bus: the robot obeyed both in turn."""
    monkeypatch.setattr(hanging, "commands_heard", lambda: heard, raising=False)
    (found,) = (one for one in listen(hanging, g1) if one.what == "alone")
    said = "commands of another program: end it" if heard else "nobody else commands"
    assert (found.good, found.seen) == (not heard, said)


def test_lost_messages_are_counted(g1: Robot, hanging: HangingRobot) -> None:
    def lose(reading: Reading) -> Reading | None:
        return None if reading.sequence % 20 == 0 else reading

    hanging.change = lose  # type: ignore[assignment]
    assert wrong(listen(hanging, g1))["lost"].endswith("readings")


def test_a_robot_that_says_nothing_is_an_error_with_what_to_look_at(g1, hanging) -> None:
    hanging.change = lambda reading: None  # type: ignore[assignment,return-value]
    hanging.dropped["damaged"] = 7
    with pytest.raises(WbcError, match=r"0 usable readings.*low-level mode.*7 damaged"):
        listen(hanging, g1)


def test_a_clock_in_steps_of_10_ms_is_told(g1: Robot, hanging: HangingRobot) -> None:
    """The check ended in a ZeroDivisionError."""
    hanging.change = lambda reading: replace(reading, time=int(reading.sequence / 5) * 5 * PERIOD)
    with pytest.raises(WbcError, match="clock stands, or is too coarse"):
        listen(hanging, g1)


def thrown(reading: Reading) -> Reading:
    return replace(reading, position=reading.position + 0.8, velocity=reading.velocity + 60.0)


@pytest.mark.parametrize(
    ("change", "said"), [(thrown, ".*_joint"), (lambda one: None, "no usable reading")]
)
def test_a_joint_thrown_about_or_silence_stops_the_check(g1, hanging, change, said: str) -> None:
    """Of a robot that fell silent all joints were said to be blocked, and commanded on."""
    hanging.change = lambda one: one if one.time < 102.0 else change(one)
    with pytest.raises(WbcError, match=f"check: {said}; motors brake"):
        moved(g1, hanging)
    assert hanging.command.is_passive and hanging.clock["now"] < 103.0


def told_by(
    monkeypatch: pytest.MonkeyPatch, bus: HangingRobot, g1: Robot, *words: str, typed: str = ""
) -> tuple[int, str]:
    """Return the exit code and words of the command, whose bus is this."""
    monkeypatch.setattr(Where, "open", lambda *given: bus)
    monkeypatch.setattr(Robot, "load", lambda name: g1)
    found = wbc_command("hardware", "check", "g1", *words, stdin=typed)
    return found.exit_code, found.output


def test_the_command_moves_nothing_unless_it_is_told_to(g1, hanging, monkeypatch) -> None:
    code, told = told_by(monkeypatch, hanging, g1, "--priority", "0", typed="no\n")
    assert code == 0 and told.count("ok ") == 9
    assert "each of the 29 joints" in told and "must hang freely" in told
    assert not hasattr(hanging, "origin")  # nothing was commanded


def test_the_command_moves_no_joint_of_a_robot_with_wrong_sensors(g1, hanging, monkeypatch) -> None:
    hanging.change = tilted
    code, told = told_by(monkeypatch, hanging, g1, "--move", "--priority", "0")
    assert code != 0 and "WRONG upright" in told and "joints are not moved" in told
    assert not hasattr(hanging, "origin")


def test_a_robot_is_upright_by_an_imu_that_is_mounted_tilted(g1, hanging: HangingRobot) -> None:
    """By its camera's, which looks down by 0.8 rad, it had fallen, and could not stand up."""
    profile = replace(profile_named("unitree_g1"), imu="d435_link")
    R = g1.snapshot(g1.postures["standing"]).rotation("d435_link")
    turns = quaternion_from(R)

    def mounted(reading: Reading) -> Reading:
        return replace(reading, quaternion=turns, specific_force=R.T @ reading.specific_force)

    hanging.change = mounted
    assert not wrong(listen(hanging, g1, 0.5, up=profile.up(g1)))
    safety = safety_of(g1, profile, PERIOD)
    hanging.sent = -1
    safety.measured(hanging.read())
    safety.judge(0.0)
    assert not safety.present
