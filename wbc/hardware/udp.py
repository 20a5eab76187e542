"""A bus by UDP: one packet for each message, without further packages or drivers.

A packet is a header (magic word, kind, number of joints, flags, sequence, time), doubles, and the
CRC-32 of all before it, little-endian. Packets with another length, header or CRC are dropped, and
those that another address than the other end's sent.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import zlib
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError
from wbc.files import system_message
from wbc.hardware.bus import BaseTruth, BusError, Command, Message, MessageOrder, Reading, newest
from wbc.kinds import check_word, whole_number
from wbc.validate import Array

COMMAND_PORT, READING_PORT = 9750, 9751
_HEAD = struct.Struct("<4sBBBxQd")
_MAGIC = b"wbc1"
_READING, _COMMAND = 1, 2
_FLAG, _TRUTH = 1, 2
_MAX_PACKET = 65536
# Packets that are read at once: neither more of them nor lasting errors hold a loop up.
_MAX_WAITING = 1024


def pack_reading(reading: Reading) -> bytes:
    """Return the packet of a reading."""
    r, truth = reading, reading.base_truth
    parts = [r.position, r.velocity, r.torque, r.temperature]
    parts += [r.quaternion, r.angular_velocity, r.specific_force]
    parts += [] if truth is None else [truth.pose, truth.velocity]
    flags = _FLAG * r.stop + _TRUTH * (truth is not None)
    return _pack(_READING, len(r.position), flags, r.sequence, r.time, np.concatenate(parts))


def unpack_reading(packet: bytes, joints: int) -> Reading | None:
    """Return the reading of a packet; None if it is not one of a robot with ``joints`` joints."""
    content = _unpack(packet, _READING, joints)
    if content is None:
        return None
    flags, sequence, time, values = content
    sizes = [joints] * 4 + [4, 3, 3] + ([7, 6] if flags & _TRUTH else [])
    if len(values) != sum(sizes):
        return None
    parts = np.split(values, np.cumsum(sizes)[:-1])
    truth = BaseTruth(parts[7], parts[8]) if flags & _TRUTH else None
    rest: Any = (*parts[:7], bool(flags & _FLAG), truth)
    return Reading(sequence, time, *rest)


def pack_command(command: Command) -> bytes:
    """Return the packet of a command."""
    c = command
    values = np.concatenate((c.position, c.velocity, c.torque, c.kp, c.kd))
    return _pack(_COMMAND, len(c.position), _FLAG * c.enabled, c.sequence, 0.0, values)


def unpack_command(packet: bytes, joints: int) -> Command | None:
    """Return the command of a packet; None if it is not one for a robot with ``joints`` joints."""
    content = _unpack(packet, _COMMAND, joints)
    if content is None or len(content[3]) != 5 * joints:
        return None
    flags, sequence, _, values = content
    position, velocity, torque, kp, kd = values.reshape(5, joints)
    return Command(sequence, position, velocity, torque, kp, kd, bool(flags & _FLAG))


class _UdpEnd:
    """One end of the bus: it receives on its ``port``, and sends to the other one."""

    def __init__(self, joints: int, to: tuple[str, int], port: int) -> None:
        self.joints, self.dropped = whole_number("UDP bus, joints", joints, least=1), Counter[str]()
        self._to = _address(to[0]), _port(to[1])
        self._socket = _open_socket(self._to[0], port)

    def close(self) -> None:
        """Close the bus."""
        self._socket.close()

    def _newest(
        self, unpack: Callable[[bytes, int], Message | None], order: MessageOrder
    ) -> Message | None:
        """Return the newest waiting message; count the dropped."""
        packets, peer = _receive_all(self._socket), self._to[0]
        own = [one for one, sender in packets if sender == peer or peer.startswith("127.")]
        if len(own) < len(packets):
            self.dropped[f"not of {peer}"] += len(packets) - len(own)
        return newest((unpack(one, self.joints) for one in own), order.is_new, self.dropped)


class UdpBus(_UdpEnd):
    """The controller's end; ``robot`` is the address to which commands go.

    Raises
    ------
    BusError
        The port is taken, or no such address.
    """

    def __init__(
        self,
        joints: int,
        robot: str = "127.0.0.1",
        *,
        port: int = READING_PORT,
        robot_port: int = COMMAND_PORT,
    ) -> None:
        super().__init__(joints, (robot, robot_port), port)

    def read(self) -> Reading | None:
        """Return the newest reading since the last call, by its sequence; None without any."""
        return self._newest(unpack_reading, MessageOrder())

    def write(self, command: Command) -> None:
        """Send a command."""
        _send(self._socket, pack_command(command), self._to)


class UdpRobotBus(_UdpEnd):
    """The robot's end; readings go to the controller at ``address``.

    Raises
    ------
    BusError
        The port is taken, or no such address.
    """

    def __init__(
        self,
        joints: int,
        address: str = "127.0.0.1",
        *,
        port: int = COMMAND_PORT,
        controller_port: int = READING_PORT,
    ) -> None:
        super().__init__(joints, (address, controller_port), port)
        self._order = MessageOrder()

    def receive(self) -> Command | None:
        """Return the newest command since the last call; None without any."""
        return self._newest(unpack_command, self._order)

    def send(self, reading: Reading) -> None:
        """Send a reading; it is no error if nobody receives it."""
        with contextlib.suppress(BusError):
            _send(self._socket, pack_reading(reading), self._to)


def _pack(kind: int, joints: int, flags: int, sequence: int, time: float, values: Array) -> bytes:
    if joints > 255:
        raise InvalidInputError(f"UDP bus: {joints} joints, at most 255 fit its packets")
    body = _HEAD.pack(_MAGIC, kind, joints, flags, sequence, time) + values.astype("<f8").tobytes()
    return body + zlib.crc32(body).to_bytes(4, "little")


def _unpack(packet: bytes, kind: int, joints: int) -> tuple[int, int, float, Array] | None:
    """Return flags, sequence, time and values of a packet; None if damaged or of another kind."""
    size = len(packet) - _HEAD.size - 4
    if size < 0 or size % 8 or zlib.crc32(packet[:-4]) != int.from_bytes(packet[-4:], "little"):
        return None
    magic, its_kind, its_joints, flags, sequence, time = _HEAD.unpack_from(packet)
    if (magic, its_kind, its_joints) != (_MAGIC, kind, joints):
        return None
    values = np.frombuffer(packet, "<f8", size // 8, _HEAD.size).astype(float)
    return flags, sequence, time, values


def _address(given: str) -> str:
    """Return an address with all of its four numbers."""
    check_word("UDP bus, address", given)
    try:
        return socket.inet_ntoa(socket.inet_aton(given))
    except OSError:
        raise BusError(f"UDP bus: expected an address as 192.168.1.2, got {given!r}") from None


def _open_socket(address: str, port: int) -> socket.socket:
    port = _port(port)
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        own.setblocking(False)
        own.bind(("127.0.0.1" if address.startswith("127.") else "0.0.0.0", port))
    except OSError as error:
        own.close()
        raise BusError(
            f"UDP bus: {address}, port {port}: {system_message(error)}; is another process of"
            " this robot running?"
        ) from error
    return own


def _port(number: int) -> int:
    """Return the number of a port; 0 for any that is free."""
    return whole_number("UDP bus, port", number, most=65535)


def _receive_all(own: socket.socket) -> list[tuple[bytes, str]]:
    """Return the waiting packets and their senders; errors, as of an absent one, are ignored."""
    packets = list[tuple[bytes, str]]()
    for _ in range(_MAX_WAITING):
        try:
            packet, (sender, _) = own.recvfrom(_MAX_PACKET)
            packets.append((packet, sender))
        except BlockingIOError:
            break
        except OSError as error:
            if own.fileno() < 0:
                raise BusError("UDP bus: it is closed; open another") from error
    return packets


def _send(own: socket.socket, packet: bytes, to: tuple[str, int]) -> None:
    try:
        own.sendto(packet, to)
    except BlockingIOError:
        pass  # the system's buffer is full; the next one is newer
    except OSError as error:
        raise BusError(f"UDP bus: {to[0]}, port {to[1]}: {system_message(error)}") from error
