"""Unitree's LowState and LowCmd messages byte by byte: fields, CDR encoding and CRC.

The fields and their order are those of the public IDL files (``unitree_hg``: G1, H1-2; and
``unitree_go``: Go2, B2, H1). A message of 35 motors takes 0.5 to 0.7 ms to encode or decode field
by field in Python; here it is one NumPy record at the byte offsets of CDR (OMG, version 1, little
endian), in which every number is aligned to its own size from the message's beginning, and nothing
is padded at the end of a nested struct. The CRC goes over the C struct's bytes, which pads that.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

CDR_HEAD = bytes((0, 1, 0, 0))  # plain CDR, little endian, no options
_REVERSED = np.array([int(f"{k:08b}"[::-1], 2) for k in range(256)], dtype=np.uint8)


class Field(NamedTuple):
    """A field of a message: a number, an array of ``size``, or of structs."""

    name: str
    kind: str | tuple[Field, ...]
    size: int = 1


MOTOR_CMD_HG = (
    Field("mode", "u1"),
    *(Field(name, "f4") for name in ("q", "dq", "tau", "kp", "kd")),
    Field("reserve", "u4"),
)
LOW_CMD_HG = (
    Field("mode_pr", "u1"),
    Field("mode_machine", "u1"),
    Field("motor_cmd", MOTOR_CMD_HG, 35),
    Field("reserve", "u4", 4),
    Field("crc", "u4"),
)
IMU_STATE_HG = (
    Field("quaternion", "f4", 4),
    Field("gyroscope", "f4", 3),
    Field("accelerometer", "f4", 3),
    Field("rpy", "f4", 3),
    Field("temperature", "i2"),
)
MOTOR_STATE_HG = (
    Field("mode", "u1"),
    *(Field(name, "f4") for name in ("q", "dq", "ddq", "tau_est")),
    Field("temperature", "i2", 2),  # of the housing, and of the winding
    Field("vol", "f4"),
    Field("sensor", "u4", 2),
    Field("motorstate", "u4"),
    Field("reserve", "u4", 4),
)
LOW_STATE_HG = (
    Field("version", "u4", 2),
    Field("mode_pr", "u1"),
    Field("mode_machine", "u1"),
    Field("tick", "u4"),
    Field("imu_state", IMU_STATE_HG),
    Field("motor_state", MOTOR_STATE_HG, 35),
    Field("wireless_remote", "u1", 40),
    Field("reserve", "u4", 4),
    Field("crc", "u4"),
)
_HEAD_GO = (
    Field("head", "u1", 2),
    Field("level_flag", "u1"),
    Field("frame_reserve", "u1"),
    Field("sn", "u4", 2),
    Field("version", "u4", 2),
    Field("bandwidth", "u2"),
)
MOTOR_CMD_GO = (*MOTOR_CMD_HG[:-1], Field("reserve", "u4", 3))
LOW_CMD_GO = (
    *_HEAD_GO,
    Field("motor_cmd", MOTOR_CMD_GO, 20),
    Field("bms_cmd", (Field("off", "u1"), Field("reserve", "u1", 3))),
    Field("wireless_remote", "u1", 40),
    Field("led", "u1", 12),
    Field("fan", "u1", 2),
    Field("gpio", "u1"),
    Field("reserve", "u4"),
    Field("crc", "u4"),
)
IMU_STATE_GO = (*IMU_STATE_HG[:-1], Field("temperature", "u1"))
MOTOR_STATE_GO = (
    Field("mode", "u1"),
    *(Field(name, "f4") for name in ("q", "dq", "ddq", "tau_est", "q_raw", "dq_raw", "ddq_raw")),
    Field("temperature", "u1"),
    Field("lost", "u4"),
    Field("reserve", "u4", 2),
)
BMS_STATE_GO = (
    *(Field(name, "u1") for name in ("version_high", "version_low", "status", "soc")),
    Field("current", "i4"),
    Field("cycle", "u2"),
    Field("bq_ntc", "u1", 2),
    Field("mcu_ntc", "u1", 2),
    Field("cell_vol", "u2", 15),
)
LOW_STATE_GO = (
    *_HEAD_GO,
    Field("imu_state", IMU_STATE_GO),
    Field("motor_state", MOTOR_STATE_GO, 20),
    Field("bms_state", BMS_STATE_GO),
    Field("foot_force", "i2", 4),
    Field("foot_force_est", "i2", 4),
    Field("tick", "u4"),
    Field("wireless_remote", "u1", 40),
    Field("bit_flag", "u1"),
    Field("adc_reel", "f4"),
    Field("temperature_ntc1", "u1"),
    Field("temperature_ntc2", "u1"),
    Field("power_v", "f4"),
    Field("power_a", "f4"),
    Field("fan_frequency", "u2", 4),
    Field("reserve", "u4"),
    Field("crc", "u4"),
)


class MessageLayout:
    """A message type: its fields and their offsets.

    ``typename``: in DDS.
    ``fields``: in order.
    ``motors``: the field with one entry for each motor.

    ``size``, ``packed_size``: of the CDR bytes, without the head; and of the C struct.
    """

    def __init__(self, typename: str, fields: tuple[Field, ...], motors: str) -> None:
        self.typename, self.fields, self.motors = typename, fields, motors
        self._cdr, self.size = _cdr_places(_flatten(fields))
        packed = _struct_dtype(fields)
        self.packed_size = packed.itemsize
        self.count = next((field.size for field in fields if field.name == motors), 0)
        # CDR offset of each byte of the C struct; padding is gathered from an extra zero.
        self._gather = np.full(self.packed_size, self.size, dtype=np.int64)
        for name, offset, length in _c_places(packed):
            start = self._cdr[name][0]
            self._gather[offset : offset + length] = np.arange(start, start + length)

    def zeros(self) -> bytearray:
        """Return the CDR bytes (without header) of a message of zeros."""
        return bytearray(self.size)

    def view(self, data: bytearray | bytes, name: str) -> NDArray[Any]:
        """Return a field, such as ``imu_state.gyroscope``, as an array over the bytes."""
        offset, kind, count = self._cdr[name]
        return np.frombuffer(data, kind, count, offset)

    @lru_cache(maxsize=64)  # noqa: B019 - two layouts, which live as long as the program
    def _motor_index(self, name: str) -> tuple[NDArray[np.int64], str]:
        places = [self._cdr[f"{self.motors}.{k}.{name}"] for k in range(self.count)]
        _, kind, _ = places[0]
        width = np.dtype(kind).itemsize * places[0][2]
        return np.array([[p[0] + b for b in range(width)] for p in places]), kind

    def motor_values(self, data: bytes | bytearray, name: str) -> NDArray[Any]:
        """Return a field of all motors (count,); the largest entry of a field with several."""
        index, kind = self._motor_index(name)
        return np.asarray(np.frombuffer(data, np.uint8)[index].view(kind).max(axis=1))

    def set_motor_values(self, data: bytearray, name: str, values: NDArray[Any]) -> None:
        """Write a field of all motors (count,); into all entries of a field with several."""
        index, kind = self._motor_index(name)
        given = np.repeat(np.asarray(values, dtype=kind), index.shape[1] // np.dtype(kind).itemsize)
        np.frombuffer(data, np.uint8)[index] = given.view(np.uint8).reshape(index.shape)

    def crc(self, data: bytes | bytearray) -> int:
        """Return the CRC over all fields but the last, which is the CRC."""
        padded = np.append(np.frombuffer(data, np.uint8), np.uint8(0))
        return crc32(padded[self._gather[:-4]].tobytes())

    def seal(self, data: bytearray) -> None:
        """Write the CRC."""
        self.view(data, "crc")[0] = self.crc(data)

    def is_sound(self, data: bytes | bytearray) -> bool:
        """Return whether the bytes are a whole message with the right CRC."""
        return len(data) == self.size and int(self.view(data, "crc")[0]) == self.crc(data)


def crc32(words: bytes) -> int:
    """Return Unitree's CRC of 32-bit little-endian words.

    It is CRC-32/MPEG-2 (polynomial 0x04C11DB7, begun with all ones, neither reflected nor inverted)
    of each word from its highest bit on. zlib's is the reflected one, which is the same as ours of
    bytes whose bits are reversed, reversed and inverted in the end.
    """
    bytes_in_order = np.frombuffer(words, "<u4").astype(">u4").view(np.uint8)
    reflected = zlib.crc32(_REVERSED[bytes_in_order].tobytes()) ^ 0xFFFFFFFF
    return int(f"{reflected:032b}"[::-1], 2)


def _flatten(fields: Sequence[Field], prefix: str = "") -> Iterator[Field]:
    """Yield the numeric fields by their dotted names."""
    for name, kind, size in fields:
        if isinstance(kind, str):
            yield Field(prefix + name, kind, size)
            continue
        for k in range(size):
            yield from _flatten(kind, f"{prefix}{name}.{k}." if size > 1 else f"{prefix}{name}.")


def _cdr_places(fields: Iterable[Field]) -> tuple[dict[str, tuple[int, str, int]], int]:
    """Return offset, type and count of each field in CDR, and the size of the whole."""
    places, offset = dict[str, tuple[int, str, int]](), 0
    for name, kind, count in fields:
        width = np.dtype(str(kind)).itemsize
        offset += -offset % width
        places[name] = offset, f"<{kind}", count
        offset += width * count
    return places, offset


def _struct_dtype(fields: Sequence[Field]) -> np.dtype[Any]:
    parts = list[Any]()
    for name, kind, count in fields:
        one = f"<{kind}" if isinstance(kind, str) else _struct_dtype(kind)
        parts.append((name, one, (count,)) if count > 1 else (name, one))
    return np.dtype(parts, align=True)


def _c_places(
    struct: np.dtype[Any], prefix: str = "", start: int = 0
) -> Iterator[tuple[str, int, int]]:
    """Yield dotted name, offset and length in bytes of each field in a C struct."""
    for name, (kind, offset, *_) in (struct.fields or {}).items():
        one, shape = kind.subdtype or (kind, ())
        if one.fields is None:
            yield prefix + name, start + offset, kind.itemsize
            continue
        for k in range(math.prod(shape)):
            inner = f"{prefix}{name}.{k}." if shape else f"{prefix}{name}."
            yield from _c_places(one, inner, start + offset + k * one.itemsize)


LAYOUTS = {
    "hg": (
        MessageLayout("unitree_hg.msg.dds_.LowState_", LOW_STATE_HG, "motor_state"),
        MessageLayout("unitree_hg.msg.dds_.LowCmd_", LOW_CMD_HG, "motor_cmd"),
    ),
    "go": (
        MessageLayout("unitree_go.msg.dds_.LowState_", LOW_STATE_GO, "motor_state"),
        MessageLayout("unitree_go.msg.dds_.LowCmd_", LOW_CMD_GO, "motor_cmd"),
    ),
}
"""State and command of each family."""
