"""Unitree's bus over DDS, both ends, by ``cyclonedds`` (the extra ``unitree``)."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from typing import Any

from wbc.errors import InvalidInputError
from wbc.extras import require
from wbc.hardware.bus import BaseTruth, BusError, Command, MessageOrder, Reading, newest
from wbc.hardware.unitree.conversion import Converter
from wbc.hardware.unitree.layout import CDR_HEAD, Field, MessageLayout
from wbc.hardware.unitree.profiles import Profile
from wbc.robot import Robot

STATE_TOPIC, COMMAND_TOPIC = "rt/lowstate", "rt/lowcmd"
# Not Unitree's: the true base of a simulated robot, if it sends that.
TRUTH_TOPIC, TRUTH_TYPE = "rt/wbc/base_truth", "wbc.BaseTruth_"
TRUTH = (Field("time", "f8"), Field("pose", "f8", 7), Field("velocity", "f8", 6))
MAX_WAITING = 16  # messages
_STRUCTS = {
    "motor_cmd": "MotorCmd_",
    "motor_state": "MotorState_",
    "imu_state": "IMUState_",
    "bms_cmd": "BmsCmd_",
    "bms_state": "BmsState_",
}
_NUMBERS = {"u1": "uint8", "u2": "uint16", "u4": "uint32", "i2": "int16", "i4": "int32"}
_NUMBERS |= {"f4": "float32", "f8": "float64"}
_DOMAINS: dict[int, tuple[str, Any]] = {}


class _DdsEnd:
    """One end of the bus: a participant of a domain on one interface.

    ``dropped``: number of dropped messages, by reason.
    """

    def __init__(self, profile: Profile, robot: Robot, interface: str, domain: int = 0) -> None:
        self._convert = Converter(profile, robot)
        self.dropped = Counter[str]()
        require("cyclonedds", "Unitree's bus")
        from cyclonedds.domain import Domain, DomainParticipant

        known = _DOMAINS.get(domain)
        if known is None:
            try:
                _DOMAINS[domain] = interface, Domain(domain, _configuration(interface))
                self._participant = DomainParticipant(domain)
            except Exception as error:  # DDSException is one of many
                _DOMAINS.pop(domain, None)
                raise BusError(f"DDS on {interface!r}: {error}; see: ip addr") from error
        elif known[0] != interface:
            raise InvalidInputError(
                f"DDS: domain {domain} is on {known[0]!r} in this process, not on {interface!r}"
            )
        else:
            self._participant = DomainParticipant(domain)

    def _reader(self, topic: str, layout: MessageLayout) -> Any:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        # Best effort matches every writer; a lost message is replaced by the next.
        qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(MAX_WAITING))
        return DataReader(self._participant, Topic(self._participant, topic, _type(layout)), qos)

    def _writer(self, topic: str, layout: MessageLayout) -> Any:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        # Reliable matches every reader; keeping one message it never blocks on a slow one.
        qos = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepLast(1))
        return DataWriter(self._participant, Topic(self._participant, topic, _type(layout)), qos)

    def close(self) -> None:
        """Close the bus."""
        del self._participant


class UnitreeBus(_DdsEnd):
    """The controller's end: reads LowState, writes LowCmd.

    ``profile``, ``robot``: the robot on the bus, and its model.
    ``interface``: network interface, such as ``eth0``; ``lo`` is this machine.
    ``domain``: of DDS.

    Raises MissingPackageError: cyclonedds is not installed; BusError: no such interface.
    """

    def __init__(self, profile: Profile, robot: Robot, interface: str, domain: int = 0) -> None:
        super().__init__(profile, robot, interface, domain)
        self._states = self._reader(STATE_TOPIC, self._convert.state)
        self._truths = self._reader(TRUTH_TOPIC, _truth_layout())
        self._commands = self._writer(COMMAND_TOPIC, self._convert.command)
        self._commands_on_bus = self._reader(COMMAND_TOPIC, self._convert.command)
        self._truth: BaseTruth | None = None  # the last: it may come after its reading

    def read(self) -> Reading | None:
        """Return the newest reading since the last call; None without any."""
        readings = map(self._convert.reading, _take_all(self._states))
        reading = newest(readings, MessageOrder().is_new, self.dropped)
        for data in _take_all(self._truths)[-1:]:
            pose, velocity = (_truth_layout().view(data, one) for one in ("pose", "velocity"))
            self._truth = BaseTruth(pose.copy(), velocity.copy())
        return None if reading is None else replace(reading, base_truth=self._truth)

    def commands_heard(self) -> int:
        """Return the number of commands on the bus since the last call, of any sender; max. 16."""
        return len(_take_all(self._commands_on_bus))

    def write(self, command: Command) -> None:
        """Send a command."""
        _write(self._commands, self._convert.low_command(command))


class UnitreeRobotBus(_DdsEnd):
    """The robot's end: reads LowCmd, writes LowState; see :class:`UnitreeBus`."""

    def __init__(self, profile: Profile, robot: Robot, interface: str, domain: int = 0) -> None:
        super().__init__(profile, robot, interface, domain)
        self._commands = self._reader(COMMAND_TOPIC, self._convert.command)
        self._states = self._writer(STATE_TOPIC, self._convert.state)
        self._truths = self._writer(TRUTH_TOPIC, _truth_layout())
        self._order = MessageOrder()

    def receive(self) -> Command | None:
        """Return the newest command since the last call; None without any.

        Commands without a number, from other programs, are taken in the order of arrival.
        """
        commands = map(self._convert.command_from, _take_all(self._commands))
        return newest(
            commands, lambda number: not number or self._order.is_new(number), self.dropped
        )

    def send(self, reading: Reading) -> None:
        """Send a reading, and before it its true base, if it has one."""
        if reading.base_truth is not None:
            layout = _truth_layout()
            data = layout.zeros()
            layout.view(data, "time")[0] = reading.time
            layout.view(data, "pose")[:] = reading.base_truth.pose
            layout.view(data, "velocity")[:] = reading.base_truth.velocity
            _write(self._truths, data)
        _write(self._states, self._convert.low_state(reading))


# ---------------------------------------------------------------------- DDS


def _configuration(interface: str) -> str:
    local = interface == "lo"  # without multicast: peers are addressed one by one
    multicast = str(not local).lower()
    peers = '<Peers><Peer address="localhost"/></Peers>' if local else ""
    return (
        "<CycloneDDS><Domain><General><Interfaces>"
        f'<NetworkInterface name="{interface}" priority="default" multicast="{multicast}"/>'
        f"</Interfaces><AllowMulticast>{multicast}</AllowMulticast></General>"
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex>{peers}</Discovery>"
        "</Domain></CycloneDDS>"
    )


@cache
def _truth_layout() -> MessageLayout:
    return MessageLayout(TRUTH_TYPE, TRUTH, "")


@cache
def _type(layout: MessageLayout) -> Any:
    """Return the message type for cyclonedds, whose messages are CDR bytes.

    It declares the whole type, by which both ends match; only the conversion of fields is skipped.
    """
    declared = _struct(layout.typename, layout.fields)

    class Message(declared):  # type: ignore[misc,valid-type]
        def __init__(self, data: bytes | bytearray) -> None:
            self.data = bytes(data)

        def serialize(self, *_: object, **__: object) -> bytes:
            return CDR_HEAD + self.data

        @classmethod
        def deserialize(cls, data: bytes, *given: Any, **named: Any) -> Any:
            if bytes(data[: len(CDR_HEAD)]) == CDR_HEAD:
                return cls(data[len(CDR_HEAD) : len(CDR_HEAD) + layout.size])
            slow = declared.deserialize(data, *given, **named)  # another encoding
            return cls(slow.serialize(use_version_2=False)[len(CDR_HEAD) :])

        @classmethod
        def deserialize_key(cls, *_: Any, **__: Any) -> Any:
            return cls(b"")  # a writer left: no message

    return Message


@cache
def _struct(typename: str, fields: tuple[Field, ...]) -> Any:
    from cyclonedds import idl
    from cyclonedds.idl import annotations
    from cyclonedds.idl import types as made_types

    types: Any = made_types

    module, name = typename.rsplit(".", 1)
    declared = dict[str, Any]()
    for field in fields:
        one = (
            getattr(types, _NUMBERS[field.kind])
            if isinstance(field.kind, str)
            else _struct(f"{module}.{_STRUCTS[field.name]}", field.kind)
        )
        declared[field.name] = types.array[one, field.size] if field.size > 1 else one
    struct = idl.make_idl_struct(name, typename, declared)
    return annotations.autoid("sequential")(annotations.final(struct))


def _take_all(reader: Any) -> list[bytes]:
    return [one.data for one in reader.take(MAX_WAITING) if getattr(one, "data", b"")]


def _write(writer: Any, data: bytes | bytearray) -> None:
    try:
        writer.write(writer.data_type(data))
    except Exception as error:  # of cyclonedds
        raise BusError(f"DDS: a message cannot be sent: {error}") from error
