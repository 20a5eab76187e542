"""The header and the parameters of a C3D file (www.c3d.org), read within bounds.

Every length in the file is checked against the bytes that are there before it is used: libraries in
C++ have been known to end the process on damaged files.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.motion.table import RecordingError
from wbc.validate import Array

BLOCK = 512
MARK = 0x50
INTEL, DEC, MIPS = 84, 85, 86
MAX_PARAMETERS = 10_000
Values = list[str] | Array


@dataclass(frozen=True, eq=False)
class C3dFile:
    """Header and parameters of a C3D file, and its bytes."""

    source: str
    data: bytes
    processor: int  # INTEL, DEC or MIPS
    header: tuple[int, ...]  # its first ten words
    scale: float  # of stored coordinates
    rate: float  # frames per second [Hz]
    # By group and name, as POINT:LABELS; arrays have the file's dimensions, first one first.
    parameters: dict[str, Values]

    @property
    def real(self) -> bool:
        """Whether points and analog samples are floats; else they are words of 16 bits."""
        return self.scale < 0.0

    def error(self, what: str) -> RecordingError:
        """Return an error that names the file."""
        return RecordingError(what, self.source)

    def numbers(self, name: str) -> Array:
        """Return a parameter's numbers; an empty array if it is not there or holds text."""
        found = self.parameters.get(name)
        return found if isinstance(found, np.ndarray) else np.zeros(0)

    def number(self, name: str, default: float) -> float:
        """Return a parameter's first number, or a default."""
        found = self.numbers(name).ravel(order="F")
        return float(found[0]) if found.size and math.isfinite(found[0]) else default

    def texts(self, name: str) -> list[str]:
        """Return a parameter's texts, then those of its continuations (LABELS2, ...)."""
        found = list[str]()
        for k in range(1, 100):
            part = self.parameters.get(name if k == 1 else f"{name}{k}")
            if not isinstance(part, list):
                break
            found += part
        return found


def read_c3d_head(data: bytes, source: str) -> C3dFile:
    """Return header and parameters of a C3D file.

    Raises RecordingError: too short, not a C3D file, or a parameter that does not fit.
    """
    if len(data) < 2 * BLOCK or data[1] != MARK:
        raise RecordingError("it does not begin as a C3D file does", source)
    start = BLOCK * (data[0] - 1)
    if data[0] < 2 or start + 4 > len(data):
        raise RecordingError("its parameters begin outside the file", source)
    processor = data[start + 3]
    if processor not in (INTEL, DEC, MIPS):
        raise RecordingError(f"unknown processor type {processor}", source)
    order = ">" if processor == MIPS else "<"
    header = struct.unpack_from(f"{order}10H", data, 0)
    scale, rate = floats(data[12:16], processor)[0], floats(data[20:24], processor)[0]
    parameters = _parameters(data, start, order, processor, source)
    return C3dFile(source, data, processor, header, float(scale), float(rate), parameters)


def floats(data: bytes, processor: int) -> Array:
    """Return the 4-byte floats of a processor."""
    with np.errstate(all="ignore"):  # bits that are no numbers become NaN
        if processor == DEC:  # VAX: halves swapped, exponent larger by 2
            halves = np.frombuffer(data, dtype="<u2").reshape(-1, 2)
            bits = (halves[:, 0].astype(np.uint32) << 16) | halves[:, 1]
            return np.asarray(bits.view(np.float32).astype(np.float64) / 4.0)
        found: NDArray[Any] = np.frombuffer(data, dtype=">f4" if processor == MIPS else "<f4")
        return np.asarray(found.astype(np.float64))


def _parameters(
    data: bytes, start: int, order: str, processor: int, source: str
) -> dict[str, Values]:
    groups, found = dict[int, str](), list[tuple[int, str, Values]]()
    at, end = start + 4, start + BLOCK * data[start + 2]
    for _ in range(MAX_PARAMETERS):
        if at + 2 > len(data):
            break
        length, group = struct.unpack_from("bb", data, at)
        if length == 0:
            break
        name_end = at + 2 + abs(length)
        if name_end + 2 > len(data):
            raise RecordingError("a parameter's name goes beyond the file", source)
        name = data[at + 2 : name_end].decode("latin-1").strip().upper()
        (offset,) = struct.unpack_from(f"{order}h", data, name_end)
        if name_end + offset > end:  # programs that rewrote a MIPS file put Intel's among its own
            (other,) = struct.unpack_from("<h" if order == ">" else ">h", data, name_end)
            offset = other if 0 < other <= end - name_end else offset
        if group < 0:
            groups[-group] = name
        else:
            found.append((group, name, _value(data, name_end + 2, order, processor, source)))
        if offset <= 0:
            break
        at = name_end + offset
    return {f"{groups.get(group, group)}:{name}": value for group, name, value in found}


def _value(data: bytes, at: int, order: str, processor: int, source: str) -> Values:
    """Return a parameter's values; texts as a list, numbers with the file's dimensions."""
    if at + 2 > len(data):
        raise RecordingError("a parameter goes beyond the file", source)
    kind, count = struct.unpack_from("bB", data, at)
    shape = tuple(data[at + 2 : at + 2 + count])
    size, first = math.prod(shape), at + 2 + count
    raw = data[first : first + size * abs(kind)]
    if kind not in (-1, 1, 2, 4) or len(shape) < count or len(raw) < size * abs(kind):
        raise RecordingError("a parameter's values do not fit into the file", source)
    if kind == -1:
        width = shape[0] if shape else 1
        lines = [raw[k : k + width] for k in range(0, len(raw), width)] if width else []
        return [line.decode("latin-1").strip(" \0") for line in lines]
    if not size:
        return np.zeros(0)
    if kind == 4:
        numbers = floats(raw, processor)
    else:
        whole: NDArray[Any] = np.frombuffer(raw, dtype="u1" if kind == 1 else f"{order}i2")
        numbers = whole.astype(np.float64)
    return numbers.reshape(shape, order="F")
