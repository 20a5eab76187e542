"""Messages of both buses: fields, sums, damage, order; and what needs no bus: logs, ROS fields."""

import errno
import itertools
import os
import socket
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from tests.problem.loading import problem_of
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.hardware.bus import BaseTruth, BusError, Command, MessageOrder, Reading, thrown_away
from wbc.hardware.operator import Script
from wbc.hardware.ring_log import RingLog
from wbc.hardware.robot_side import RobotSettings
from wbc.hardware.ros import fill, joint_state, odometry, stamp, state_of
from wbc.hardware.setup import Where, loop_of, omissions, simulated_robot
from wbc.hardware.udp import (
    UdpBus,
    UdpRobotBus,
    pack_command,
    pack_reading,
    unpack_command,
    unpack_reading,
)
from wbc.hardware.unitree import profile_named
from wbc.hardware.unitree.conversion import Converter
from wbc.hardware.unitree.layout import CDR_HEAD, LAYOUTS, crc32
from wbc.problem import Problem
from wbc.robot import Robot

N = 29


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        return int(own.getsockname()[1])


@pytest.fixture
def reading() -> Reading:
    draw = np.random.default_rng(0).normal
    turn = draw(size=4)
    joints = (draw(size=N) for _ in range(3))
    truth = BaseTruth(draw(size=7), draw(size=6))
    imu = (turn / np.linalg.norm(turn), draw(size=3), draw(size=3))
    return Reading(42, 0.042, *joints, np.arange(N) + 20.0, *imu, True, truth)


@pytest.fixture
def command() -> Command:
    draw = np.random.default_rng(1).normal
    return Command(7, *(draw(size=N) for _ in range(5)))


def assert_same(one: object, other: object, places: float) -> None:
    for name, value in vars(one).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(getattr(other, name), value, rtol=0.0, atol=places)


# ---------------------------------------------------------------------- UDP


def test_packets_return_what_was_packed(reading: Reading, command: Command) -> None:
    back = unpack_reading(pack_reading(reading), N)
    told = unpack_command(pack_command(command), N)
    assert back is not None and told is not None and back.base_truth is not None
    assert_same(reading, back, 0.0)
    assert_same(command, told, 0.0)
    assert_same(reading.base_truth, back.base_truth, 0.0)
    assert (back.sequence, back.time, back.stop) == (42, 0.042, True)
    assert (told.sequence, told.enabled) == (7, True)


def test_a_packet_with_any_byte_changed_is_thrown_away(command: Command) -> None:
    packet = pack_command(command)
    for place in range(0, len(packet), 7):
        wrong = bytearray(packet)
        wrong[place] ^= 0x10
        assert unpack_command(bytes(wrong), N) is None, place
    assert unpack_command(packet[:-8], N) is None and unpack_command(b"", N) is None
    assert unpack_command(packet, N - 1) is None and unpack_reading(packet, N) is None


def test_udp_takes_each_command_once_and_the_newest_reading(reading, command: Command) -> None:
    ports = free_port(), free_port()
    robot = UdpRobotBus(N, port=ports[0], controller_port=ports[1])
    bus = UdpBus(N, port=ports[1], robot_port=ports[0])
    try:
        assert robot.receive() is None and bus.read() is None
        for number in (3, 2, 3):
            bus.write(command.numbered(number))
        taken = robot.receive()
        assert taken is not None and taken.sequence == 3 and robot.receive() is None
        assert robot.dropped["repeated or out of order"] == 2
        for number in (5, 6, 4):
            robot.send(replace(reading, sequence=number))
        newest = bus.read()
        assert newest is not None and newest.sequence == 6
        with pytest.raises(BusError, match="is another process of this robot"):
            UdpBus(N, port=ports[1])
        bus.write(command.numbered(5000))
        assert robot.receive() is not None
        bus.write(command.numbered(1))  # the loop was begun again; the robot was not
        again = robot.receive()
        assert again is not None and again.sequence == 1
    finally:
        robot.close()
        bus.close()
    for ask in (robot.receive, bus.read):
        with pytest.raises(BusError, match="it is closed"):
            ask()


@pytest.mark.parametrize(
    "always", [OSError(errno.ENETDOWN, "network is down"), (b"flood", ("127.0.0.1", 1))]
)
def test_a_loop_goes_on_beside_a_network_that_is_down_or_floods(always: object) -> None:
    """It read until nothing waited, for ever."""
    bus = UdpBus(N, port=0)
    bus.close()
    answers = SimpleNamespace(fileno=lambda: 7, recvfrom=Mock(side_effect=itertools.repeat(always)))
    bus._socket = answers  # type: ignore[assignment]
    assert bus.read() is None


def test_packets_of_others_than_the_robot_are_dropped_and_counted(reading: Reading) -> None:
    """Readings were taken of whoever sent them, and commands likewise."""
    bus, stranger = UdpBus(N, "192.0.2.1", port=0), UdpRobotBus(N, port=0, controller_port=0)
    heard = UdpBus(N, "127.1", port=0)
    try:
        for end, taken in ((bus, False), (heard, True)):
            stranger._to = "127.0.0.1", end._socket.getsockname()[1]
            stranger.send(reading)
            assert (end.read() is not None) is taken
        assert thrown_away(bus.dropped) == "; thrown away: 1 not of 192.0.2.1" and not heard.dropped
    finally:
        for one in (bus, stranger, heard):
            one.close()


def test_a_sender_that_was_begun_again_is_heard_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also after so short a run that its numbers are not far back."""
    clock = [5.0]
    monkeypatch.setattr("wbc.hardware.bus.monotonic", lambda: clock[0])
    order = MessageOrder()
    assert [order.is_new(number) for number in (1, 400, 399, 400)] == [True, True, False, False]
    clock[0] += 1.5
    assert [order.is_new(number) for number in (1, 2, 2)] == [True, True, False]


# ---------------------------------------------------------------------- Unitree


def test_sizes_of_c_structs_are_those_that_unitree_gives() -> None:
    sizes = {name: tuple(one.packed_size for one in pair) for name, pair in LAYOUTS.items()}
    assert sizes == {"hg": (2092, 1004), "go": (1180, 812)}


def test_crc_is_that_of_the_bitwise_definition() -> None:
    words = np.random.default_rng(2).integers(0, 2**32, 50, dtype=np.uint32)
    assert crc32(words.astype("<u4").tobytes()) == crc_mpeg2(words.astype(">u4").tobytes())
    assert crc_mpeg2(b"123456789") == 0x0376E6E7  # by the catalogue of parametrised CRCs


def crc_mpeg2(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = ((crc << 1) ^ (0x04C11DB7 if crc & 0x80000000 else 0)) & 0xFFFFFFFF
    return crc


@pytest.mark.parametrize("family", ["hg", "go"])
def test_layouts_are_what_cyclonedds_encodes_field_by_field(family: str) -> None:
    pytest.importorskip("cyclonedds")
    from wbc.hardware.unitree.dds import _struct

    random = np.random.default_rng(3)
    for layout in LAYOUTS[family]:
        message = _struct(layout.typename, layout.fields).deserialize(
            CDR_HEAD + random.integers(0, 100, layout.size, dtype=np.uint8).tobytes()
        )
        data = message.serialize(use_version_2=False)[len(CDR_HEAD) :]
        assert len(data) == layout.size
        motors = getattr(message, layout.motors)
        for name in ("q", "dq", "mode"):
            told = [getattr(motor, name) for motor in motors]
            np.testing.assert_array_equal(layout.motor_values(data, name), told)
        assert layout.view(data, "crc")[0] == message.crc


def test_unitree_messages_return_what_was_sent_in_single_precision(g1, reading, command) -> None:
    convert = Converter(profile_named("unitree_g1"), g1)
    back = convert.reading(bytes(convert.low_state(reading)))
    told = convert.command_from(bytes(convert.low_command(command)))
    assert back is not None and told is not None and back.stop
    assert_same(replace(reading, temperature=np.floor(reading.temperature)), back, 1e-6)
    assert_same(command, told, 1e-6)  # of single precision, for numbers below 4
    assert told.sequence == 7 and told.enabled
    data = convert.low_command(command)
    data[100] ^= 1
    assert convert.command_from(bytes(data)) is None


def test_joints_are_at_the_motors_that_unitree_numbers(g1: Robot, command: Command) -> None:
    convert = Converter(profile_named("unitree_g1"), g1)
    position = np.zeros(N)
    position[g1.joint_names.index("right_elbow_joint")] = 1.5
    data = convert.low_command(replace(command, position=position))
    sent = convert.command.motor_values(data, "q")
    assert np.flatnonzero(sent).tolist() == [25]  # RightElbow of G1JointIndex
    assert convert.command.motor_values(data, "mode").tolist() == [1] * 29 + [0] * 6


def test_a_motor_is_as_warm_as_the_warmer_of_its_housing_and_winding(g1, reading) -> None:
    convert = Converter(profile_named("unitree_g1"), g1)
    data = convert.low_state(reading)
    convert.state.view(data, "motor_state.3.temperature")[:] = 60, 110
    convert.state.view(data, "motor_state.4.temperature")[:] = 110, 60
    convert.state.seal(data)
    back = convert.reading(bytes(data))
    assert back is not None and back.temperature[3:5].tolist() == [110.0, 110.0]


@pytest.mark.slow
def test_dds_takes_each_command_once_and_the_newest_reading(g1, reading, command) -> None:
    pytest.importorskip("cyclonedds")
    profile = profile_named("unitree_g1")
    domain = os.getpid() % 200  # another suite may run at the same time
    robot = Where(interface="lo", domain=domain).open_robot(profile, g1)
    bus = Where(interface="lo", domain=domain).open(profile, g1)
    try:
        assert robot.receive() is None and bus.read() is None
        taken, newest = None, None
        for number in range(10, 400):  # until both have found each other
            bus.write(command.numbered(number))
            robot.send(replace(reading, sequence=number))
            time.sleep(0.02)
            taken, newest = robot.receive() or taken, bus.read() or newest
            if taken is not None and newest is not None and newest.base_truth is not None:
                break
        assert taken is not None and newest is not None and newest.base_truth is not None
        assert_same(taken, command, 1e-6)
        assert bus.commands_heard() and not bus.commands_heard()  # type: ignore[attr-defined]
        np.testing.assert_array_equal(newest.base_truth.pose, reading.base_truth.pose)  # type: ignore[union-attr]
        for number in (2, 1):  # after later ones
            bus.write(command.numbered(number))
        time.sleep(0.2)
        assert robot.receive() is None and robot.dropped["repeated or out of order"] > 0
        for number in (5000, 1):  # the loop was begun again; the robot was not
            bus.write(command.numbered(number))
            time.sleep(0.2)
            taken = robot.receive()
            assert taken is not None and taken.sequence == number
        bus.read()
        for seconds in (5.0, 0.001):  # so was the robot, between two cycles of the loop
            robot.send(replace(reading, time=seconds))
        time.sleep(0.2)
        newest = bus.read()
        assert newest is not None and newest.sequence == 1
        with pytest.raises(InvalidInputError, match=f"domain {domain} is on 'lo' in this process"):
            Where(interface="eth9", domain=domain).open(profile, g1)
        with pytest.raises(BusError, match=r"DDS on .eth9.*see: ip addr"):
            Where(interface="eth9", domain=domain + 1).open(profile, g1)
        with pytest.raises(UnknownNameError, match="unknown bus 'ddds'"):
            Where(bus="ddds").open(profile, g1)
    finally:
        robot.close()
        bus.close()


def test_another_robot_is_refused_by_its_joints(g1: Robot) -> None:
    """Of two joints with one motor the last one's commands were sent, in silence."""
    profile = profile_named("unitree_g1")
    motors = {**profile.motors, "left_knee_joint": profile.motors["right_knee_joint"]}
    with pytest.raises(InvalidInputError, match="one motor for joints left_knee_joint, right_knee"):
        replace(profile, motors=motors).order(g1)
    with pytest.raises(InvalidInputError, match=r"no motor for joint .*; lock them"):
        profile_named("unitree_g1").order(Robot.load("hoap2_like"))
    with pytest.raises(UnknownNameError, match="did you mean 'unitree_g1'"):
        profile_named("unitree_g")


# ---------------------------------------------------------------------- log and ROS


def test_a_ring_log_has_the_last_rows_in_order() -> None:
    ring = RingLog({"time": 1, "torque": 2}, seconds=0.010, dt=0.002)
    for k in range(12):
        ring.add({"time": k, "torque": (k, -k)} if k != 9 else {"time": k})
    arrays = ring.arrays()
    assert arrays["time"].tolist() == [7, 8, 9, 10, 11]
    assert arrays["torque"][1].tolist() == [8, -8] and np.isnan(arrays["torque"][2]).all()
    assert ring.arrays(2)["time"].tolist() == [10, 11]
    with pytest.raises(InvalidInputError, match="no field 'torqe'"):
        ring.add({"torqe": (0, 0)})


def test_ros_fields_return_the_state(g1: Robot, reading: Reading) -> None:
    q = g1.postures["standing"].copy()
    q[:3] = 1.0, 2.0, 3.0
    v = np.random.default_rng(4).normal(size=g1.nv)
    v[6:] = reading.velocity
    joints = joint_state(g1, reading)
    base = odometry(q, v, 12.25, pose_covariance=np.eye(6))
    assert base["header"]["stamp"] == {"sec": 12, "nanosec": 250_000_000}
    shuffled = np.random.default_rng(5).permutation(N)
    mixed = {key: [joints[key][k] for k in shuffled] for key in ("name", "position", "velocity")}
    found_q, found_v = state_of(g1, mixed, base)
    np.testing.assert_array_equal(found_q, np.concatenate((q[:7], reading.position)))
    np.testing.assert_array_equal(found_v, v)
    lacking = {key: values[1:] for key, values in mixed.items()}
    with pytest.raises(InvalidInputError, match="JointState: no joint "):
        state_of(g1, lacking, base)
    with pytest.raises(InvalidInputError, match=f"velocity: 0 numbers of {N} joints"):
        state_of(g1, {**mixed, "velocity": []}, base)  # which ROS allows
    pose = base["pose"]["pose"]
    pose["orientation"] = dict(sorted(pose["orientation"].items()))  # w first, as JSON may have it
    np.testing.assert_array_equal(state_of(g1, mixed, base)[0], found_q)
    del pose["orientation"]["w"]
    with pytest.raises(InvalidInputError, match="Odometry, orientation: no w"):
        state_of(g1, mixed, base)
    message = SimpleNamespace(header=SimpleNamespace(stamp=SimpleNamespace()))
    fill(message, {"header": joints["header"], "name": joints["name"]})
    assert message.header.stamp.nanosec == 42_000_000 and message.name == list(g1.joint_names)


def test_a_time_that_is_no_number_is_refused_by_ros_messages() -> None:
    with pytest.raises(InvalidInputError, match="ROS, time: must be finite, got nan"):
        stamp(np.nan)


def test_ros_messages_are_read_as_their_dictionaries(g1: Robot, reading: Reading) -> None:
    """They ended in a TypeError, a missing field in a KeyError; of a joint twice one counted."""

    def message(fields: dict[str, Any]) -> SimpleNamespace:
        parts = {k: message(one) if isinstance(one, dict) else one for k, one in fields.items()}
        return SimpleNamespace(**parts)

    joints = joint_state(g1, reading)
    base = odometry(g1.postures["standing"], np.zeros(g1.nv), 1.0)
    found = state_of(g1, message(joints), message(base))
    for part, of_message in zip(state_of(g1, joints, base), found, strict=True):
        np.testing.assert_array_equal(part, of_message)
    with pytest.raises(InvalidInputError, match="Odometry: no twist"):
        state_of(g1, joints, {"pose": base["pose"]})
    double = {key: [*joints[key], joints[key][0]] for key in ("name", "position", "velocity")}
    with pytest.raises(InvalidInputError, match=f"twice {g1.joint_names[0]}"):
        state_of(g1, double, base)


def test_a_ring_is_shared_with_the_process_that_writes(tmp_path: Path) -> None:
    from wbc.hardware.ring_log import LogWriter
    from wbc.hardware.worker import can_fork

    if not can_fork():
        pytest.skip("no fork here")
    ring = RingLog({"time": 1}, seconds=1.0, dt=0.1)
    writer = LogWriter(ring, tmp_path / "log.npz", 5, {"estimator": "none"}, forked=True)
    for k in range(8):
        ring.add({"time": k})
    writer.write(["one", "two"], "a test")
    writer.close()
    assert writer.written == [tmp_path / "log.npz"] and not writer.errors
    with np.load(tmp_path / "log.npz") as log:
        assert log["time"].tolist() == [3, 4, 5, 6, 7]
        assert log["events"].tolist() == ["one", "two"] and log["about"] == "a test"


STAND_G1 = """
robot: {model: g1, locked: {waist_yaw_joint: 0.0}}
support: double
tasks: {posture: {type: posture}}
controller: {level: torque}
simulation: {duration: 1, wrenches: [{frame: base, force: [0, 0, -10], told: true}]}
"""
BOLTED = STAND_G1.replace("locked: {waist_yaw_joint: 0.0}", "base: fixed")


def test_what_is_left_out_is_said_and_another_robot_refused_on_any_bus(tmp_path, g1) -> None:
    """UDP counts joints alone: an H1-2 with as many would be commanded in the order of a G1."""
    problem, profile = problem_of(tmp_path, STAND_G1), profile_named("unitree_g1")
    assert isinstance(problem, Problem)
    off, untold = omissions(problem, profile)
    assert off.endswith("or locked: waist_yaw_joint") and "wrenches" in untold
    other = profile_named("unitree_h1_2")
    with pytest.raises(InvalidInputError, match="no motor for joint waist_roll_joint"):
        loop_of(problem, other, lambda: pytest.fail("opened"), Script(1.0), forked=False)
    bolted = problem_of(tmp_path, BOLTED.replace("double", "floating"))
    assert isinstance(bolted, Problem)
    with pytest.raises(InvalidInputError, match="has a fixed base, and the loop stands a robot up"):
        loop_of(bolted, profile, lambda: pytest.fail("opened"), Script(1.0), estimator="truth")
    with pytest.raises(InvalidInputError, match="no motor for joint waist_yaw_joint"):
        simulated_robot(g1, other, None, RobotSettings())  # type: ignore[arg-type]
