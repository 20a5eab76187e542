"""Limits that would never be exceeded are refused; what has another size is a fault, no crash."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import urdf
from wbc.errors import InvalidInputError
from wbc.hardware.bus import Command, Reading
from wbc.hardware.safety import Fault, Safety
from wbc.hardware.safety_limits import SafetyLimits
from wbc.hardware.sensor_checks import SensorChecks
from wbc.robot import Robot

DT = 0.002
ROBOT = Robot.load("g1")
N = len(ROBOT.joint_names)
LIMITS = SafetyLimits.of(ROBOT, np.full(N, 100.0), np.full(N, 5.0))
NAN = np.full(N, np.nan)


def reading(**changed: Any) -> Reading:
    zero = np.zeros(N)
    imu = np.array((0.0, 0.0, 0.0, 1.0)), np.zeros(3), np.array((0.0, 0.0, 9.81))
    made = Reading(1, 0.0, zero, zero, zero, np.full(N, 30.0), *imu)
    return replace(made, **changed)


def standing_up(limits: SafetyLimits = LIMITS) -> Safety:
    safety = Safety(limits, np.ones(N), DT)
    safety.arm(0.0)
    safety.measured(reading())
    safety.stand_up(0.0)
    return safety


def judged(safety: Safety, at: float = 0.0, **changed: Any) -> tuple[Fault, ...]:
    """Return the faults that are there after a reading."""
    safety.measured(reading(**changed))
    safety.judge(at)
    return safety.present


def watched(checks: SensorChecks, k: int, force: float, **changed: Any) -> tuple[bool, Any]:
    """Look at the k-th reading: a specific force [m/s^2] along z, and a little noise."""
    noise = 1e-3 * (k % 7)
    now = reading(sequence=k + 1, time=DT * k, specific_force=np.array((noise, 0.0, force)))
    return checks.look_at(replace(now, angular_velocity=np.full(3, noise), **changed), DT * k)


@pytest.mark.parametrize(
    "wrong",
    [
        {"lower": NAN},
        {"lower": LIMITS.upper, "upper": LIMITS.lower},
        {"lower": LIMITS.lower[:-1]},
        {"velocity": NAN},
        {"velocity": -LIMITS.velocity},
        {"names": LIMITS.names[:-1]},
        {"up": (0.0, 0.0, 0.0)},
        {"up": (0.0, 1.0)},
        {"warm": np.nan},
        {"hot": 20.0},
        {"tilt": 7.0},
    ],
    ids=str,
)
def test_limits_that_nothing_can_exceed_or_keep_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InvalidInputError, match="safety limits, "):
        replace(LIMITS, **wrong)


def test_joints_without_a_motor_need_no_effort_limit() -> None:
    """Efforts are asked for where there are motors, and all that lack one are named."""
    free = urdf.joint("hip", "trunk", "thigh", limit=urdf.limit(effort=0))
    knee = urdf.joint("knee", "thigh", "shank", limit=urdf.limit(effort=9))
    text = urdf.robot("leg", *map(urdf.link, ("trunk", "thigh", "shank")), free, knee)
    gains = np.ones(2), np.ones(2)
    with pytest.raises(InvalidInputError, match="hip of leg have no effort limit"):
        SafetyLimits.of(Robot.load(text, feet={}), *gains)
    limits = SafetyLimits.of(Robot.load(text, feet={}, unactuated=["hip"]), *gains)
    assert limits.effort[1] == 9.0 and np.isfinite(limits.effort[0])
    safety = Safety(limits, np.ones(2), DT)
    still = np.zeros(2)
    safety.measured(
        reading(position=still, velocity=still, torque=np.array((1e-3, 0.0)), temperature=still)
    )
    safety.judge(0.0)
    assert not safety.present  # what a sensor reads there is no overload


def test_limits_may_be_lists_and_nobody_changes_them() -> None:
    """Lists ended in a TypeError at the first reading; arrays were the caller's own."""
    arrays = ("lower", "upper", "velocity", "effort", "kp", "kd", "torque_rate")
    own = np.array(LIMITS.effort)
    lists = {name: getattr(LIMITS, name).tolist() for name in arrays}
    limits = replace(LIMITS, **lists | {"effort": own})
    own[:] = 1e9
    safety = Safety(limits, [1.0] * N, DT)
    assert judged(safety, torque=np.full(N, 1e6)) == (Fault.OVERLOAD,)
    assert not any(getattr(limits, name).flags.writeable for name in arrays)


def test_tilt_does_not_depend_on_how_long_the_axis_is_written() -> None:
    """By 1 rad about x; more than 0.8. Twice the axis would have had twice the cosine, 1.08."""
    leaning = np.array((np.sin(0.5), 0.0, 0.0, np.cos(0.5)))
    for length in (1.0, 2.0):
        safety = Safety(replace(LIMITS, up=(0.0, 0.0, length)), np.ones(N), DT)
        assert judged(safety, quaternion=leaning) == (Fault.TILT,)


def test_damping_that_speeds_joints_up_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="must not be negative"):
        Safety(LIMITS, np.full(N, -1.0), DT)


@pytest.mark.parametrize(
    "torque",
    [np.zeros(N - 1), np.zeros(1), 0.0, None, np.full(N, "a"), np.zeros(N) + 1j],
    ids=["short", "one", "number", "None", "words", "complex"],
)
def test_command_of_another_size_is_a_fault_and_the_last_one_is_held(torque: Any) -> None:
    safety, fine = standing_up(), [np.full(N, 0.1), np.zeros(N), np.zeros(N)]
    gains = np.full(N, 10.0), np.ones(N)
    before = safety.admit(Command(1, *fine, *gains))
    assert safety.admit(Command(2, *fine[:2], torque, *gains)) is before
    rows = [np.zeros(N - 1)] * 5  # all of them
    assert safety.admit(Command(3, *rows)) is before
    assert Fault.COMMAND_NOT_FINITE in judged(safety, DT)


@pytest.mark.parametrize(
    "wrong",
    [
        {"position": np.zeros(N - 1)},
        {"position": None},
        {"temperature": np.zeros(3)},
        {name: np.zeros(N + 1) for name in ("position", "velocity", "torque", "temperature")},
        {"position": np.full(N, "a")},
        {"quaternion": np.zeros(3)},
        {"specific_force": 9.81},
    ],
    ids=str,
)
def test_reading_of_another_size_is_of_no_use_and_said(wrong: dict[str, Any]) -> None:
    useful, (found,) = SensorChecks(ROBOT).look_at(reading(**wrong), 0.0)
    assert not useful and found.fault is Fault.NOT_FINITE
    if "specific_force" not in wrong:
        assert judged(standing_up(), **wrong) == (Fault.NOT_FINITE,)


def test_a_reading_without_an_orientation_is_not_upright() -> None:
    assert judged(standing_up(), quaternion=np.zeros(4)) == (Fault.NOT_FINITE,)


def test_held_command_keeps_the_efforts_of_a_joint_that_moved_on() -> None:
    """100 N m/rad times 1.5 rad are more than the 88 N m of a hip; 0.3 rad were not."""
    safety = standing_up()
    command = Command(1, np.zeros(N), np.zeros(N), np.zeros(N), np.full(N, 100.0), np.zeros(N))
    before = safety.admit(command)
    moved = np.full(N, 1.5)
    assert (np.abs(before.motor_torque(moved, np.zeros(N))) > LIMITS.effort).any()
    for wanted in (None, replace(command, torque=NAN)):
        safety.measured(reading(position=moved))
        held = safety.admit(wanted)
        made = np.abs(held.torque + held.kp * (held.position - moved))
        assert (made <= LIMITS.effort * (1.0 + 1e-9)).all()
    assert (np.abs(made - LIMITS.effort)[LIMITS.effort < 100.0] < 1e-6).all()  # no less than it can


@pytest.mark.parametrize(
    ("position", "velocity"), [(NAN, np.zeros(N)), (np.zeros(N), NAN), (np.full(N, 1e308), NAN)]
)
def test_reading_with_nan_is_a_fault_and_reaches_no_command(position: Any, velocity: Any) -> None:
    safety = standing_up()
    assert judged(safety, position=position, velocity=velocity) == (Fault.NOT_FINITE,)
    gains = np.full(N, 10.0), np.ones(N)
    command = safety.admit(Command(1, np.full(N, 0.1), np.zeros(N), np.zeros(N), *gains))
    assert all(np.isfinite(part).all() for part in (command.torque, command.kp, command.position))


@pytest.mark.parametrize("name", ["position", "velocity"])
def test_huge_command_of_joints_without_limits_is_a_fault_and_no_nan(name: str) -> None:
    free = np.full(N, np.inf)
    safety = standing_up(replace(LIMITS, lower=-free, upper=free, velocity=free))
    zero, gains = np.zeros(N), np.full(N, 10.0)
    before = safety.admit(Command(1, zero, zero, zero, gains, gains))
    wild = replace(before, **{name: np.full(N, 1e308)})
    assert safety.admit(wild) is before
    safety.judge(0.0)
    assert safety.present == (Fault.COMMAND_NOT_FINITE,)


@pytest.mark.parametrize("times", [1.0 / 9.81, 3.28], ids=["g", "feet"])
def test_an_accelerometer_of_another_unit_is_no_fall_of_ten_metres(times: float) -> None:
    """In g it was taken for free fall, for ever."""
    checks, found = SensorChecks(ROBOT), dict[float, str]()
    for k in range(2000):  # the unit changes after a second
        useful, shown = watched(checks, k, 9.81 * (times if k > 500 else 1.0))
        assert useful
        if shown:
            found[DT * k] = f"{shown[0].fault}: {shown[0].detail}"
    assert 2.0 < min(found) < 2.7  # longer than any fall
    assert set(found.values()) >= {
        f"{Fault.GRAVITY_DISAGREES}: {9.81 * times:.1f} m/s^2 on average,"
        " for too long to be a fall; another unit?"
    }


def test_a_jump_of_a_second_is_no_fault_of_the_accelerometer() -> None:
    checks = SensorChecks(ROBOT)
    for k in range(1500):
        force = 1e-3 * (k % 7) if 500 < k < 950 else 9.81
        assert watched(checks, k, force) == (True, ())


def test_an_encoder_that_begins_anew_after_a_turn_has_not_jumped(hoap2: Robot, tmp_path) -> None:
    """Of joints without a range only: a robot was stopped where one passed half a turn."""
    head = '<joint name="head_yaw" type='
    text = Path(str(hoap2.path)).read_text().replace(head + '"revolute"', head + '"continuous"')
    (tmp_path / "r.urdf").write_text(text)
    robot, rate = Robot.load(tmp_path / "r.urdf"), 2.0
    checks, still = SensorChecks(robot), robot.limits.joint_positions(robot.postures["standing"])
    moves = np.arange(len(still)) == robot.joint_names.index("head_yaw")
    others = {"torque": 0.0 * still, "temperature": 30.0 + 0.0 * still}
    for k in range(200):
        at = np.remainder(np.pi - 0.2 + rate * DT * k + np.pi, 2.0 * np.pi) - np.pi
        joints = {"position": np.where(moves, at, still), "velocity": rate * moves, **others}
        assert watched(checks, k, 9.81, **joints) == (True, ())


@pytest.mark.parametrize("ahead", [0.009, 0.011, 0.03, 0.049])
def test_one_time_ahead_costs_one_reading_at_most(ahead: float) -> None:
    """It was taken for the freshest one: all after it were too old, and the robot went down."""
    checks, late = SensorChecks(ROBOT), 0.009  # of the last readings
    usable = [
        watched(checks, k, 9.81, time=DT * k + ahead * (k == 20) - late * (k > 50))[0]
        for k in range(60)
    ]
    assert [k for k, good in enumerate(usable) if not good] == ([20] if ahead > 0.01 else [])


def test_a_first_message_that_came_late_costs_five_readings() -> None:
    checks = SensorChecks(ROBOT)
    usable = [watched(checks, k, 9.81, time=DT * k - 0.03 * (k == 0))[0] for k in range(60)]
    assert usable[0] and not any(usable[1:6]) and all(usable[6:])


def test_a_joint_without_a_range_is_held_in_the_turn_of_its_encoder() -> None:
    """Where that began anew, the target was a turn away, and the motor pushed with its effort."""
    endless = np.where(np.arange(N) == 3, np.inf, 1.0)
    safety = standing_up(replace(LIMITS, lower=-endless * 10.0, upper=endless * 10.0))
    rows = np.zeros(N), np.zeros(N), np.full(N, 100.0), np.full(N, 5.0)

    def admitted(encoder: float, target: float | None) -> Command:
        position = np.where(np.arange(N) == 3, encoder, 0.0)
        safety.measured(reading(position=position))
        if target is None:
            return safety.admit(None)
        goal = np.where(np.arange(N) == 3, target, 0.0)
        return safety.admit(Command(1, goal, *rows))

    assert admitted(np.pi - 1e-3, np.pi - 1e-3).position[3] == pytest.approx(np.pi - 1e-3)
    for target in (None, np.pi, 5.0 * np.pi + 1e-3, -np.pi + 1e-3):
        error = admitted(-np.pi + 1e-3, target).position[3] - (-np.pi + 1e-3)
        assert abs(error) < 3e-3, target
