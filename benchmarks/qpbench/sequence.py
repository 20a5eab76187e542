"""QPs in the order in which a controller solved them, in a compact file.

Little changes from tick to tick, so every number is stored as its bits' difference from the same
entry one QP before (exclusive or), bytes of equal weight together, and compressed: lossless, and
mostly zeros.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError
from wbc.files import ArrayFileError, read_arrays, write_arrays
from wbc.qp import QP, Labels, check_qp

FORMAT = "wbc qp sequence 1"
ENDING = ".qps.npz"
FIELDS = ("P", "g", "A", "b", "C", "l", "u", "lower", "upper")
LARGEST = 2 << 30  # of a file, unpacked [bytes]
Sizes = tuple[int, int, int]  # unknowns, equality rows, inequality rows


@dataclass(frozen=True, eq=False)
class QpSequence:
    """QPs in order."""

    name: str  # such as g1 torque hard
    about: Mapping[str, Any]  # what it was recorded from: level, robot and so on, as plain data
    qps: tuple[QP, ...]

    def sizes(self) -> list[Sizes]:
        """Return unknowns, equality and inequality rows of each QP."""
        return [(qp.g.size, qp.b.size, qp.u.size) for qp in self.qps]


def save_sequence(path: Path, sequence: QpSequence) -> None:
    """Write a sequence, whole or not at all; names of rows and unknowns are left out.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    head = {"format": FORMAT, "name": sequence.name, "about": dict(sequence.about)}
    entries: dict[str, Any] = {
        "head": np.array(json.dumps(head)),
        "sizes": np.array(sequence.sizes(), dtype=np.int64).reshape(-1, 3),
    }
    for field in FIELDS:
        parts = [
            _packed(np.array([getattr(qp, field).ravel() for qp in run]))
            for _, run in _runs(sequence)
        ]
        entries[field] = np.concatenate([np.zeros(0, dtype=np.uint8), *parts])
    write_arrays(path, entries)


def load_sequence(path: Path) -> QpSequence:
    """Read a sequence.

    Raises
    ------
    ArrayFileError
        Missing, damaged or truncated.
    InvalidInputError
        Something else, of another version, or a QP that is none.
    """
    wanted = ("head", "sizes", *FIELDS)
    arrays = read_arrays(
        path, lambda names: [one for one in names if one in wanted], _kinds, LARGEST
    )
    head = _head(path, arrays.get("head"))
    missing = [name for name in wanted if name not in arrays]
    if missing:
        raise ArrayFileError(path, "missing; record it again", missing[0])
    sizes = arrays["sizes"]
    if sizes.ndim != 2 or sizes.shape[1] != 3 or (sizes < 0).any() or not (sizes[:, 0] > 0).all():
        raise ArrayFileError(path, f"expected (k, 3) sizes, got shape {sizes.shape}", "sizes")
    runs = [(size, len(list(run))) for size, run in groupby(map(tuple, sizes.tolist()))]
    columns: dict[str, list[NDArray[np.float64]]] = {}
    for field in FIELDS:
        shapes = [_shape(field, *size) for size, _ in runs]
        lengths = [
            8 * count * int(np.prod(shape)) for shape, (_, count) in zip(shapes, runs, strict=True)
        ]
        data = arrays[field]
        if data.shape != (sum(lengths),):
            what = f"{data.size} bytes for {len(sizes)} QPs, expected {sum(lengths)}; truncated?"
            raise ArrayFileError(path, what, field)
        parts = np.split(data, np.cumsum(lengths)[:-1])
        columns[field] = [
            one
            for part, shape, (_, count) in zip(parts, shapes, runs, strict=True)
            for one in _unpacked(part, count).reshape(count, *shape)
        ]
    labels = {size: Labels.numbered(*size) for size, _ in runs}
    qps = [
        QP(**{field: columns[field][k] for field in FIELDS}, labels=labels[tuple(size)])
        for k, size in enumerate(sizes.tolist())
    ]
    for k, qp in enumerate(qps):
        try:
            check_qp(qp)
        except InvalidInputError as error:
            raise InvalidInputError(f"{path}: QP {k}: {error}") from error
    return QpSequence(str(head["name"]), head["about"], tuple(qps))


def _head(path: Path, text: NDArray[Any] | None) -> dict[str, Any]:
    """Return the kind of a file, from its header."""
    try:
        head = json.loads(str(text))
        found, about = head["format"], head["about"]
        head["name"], about.items()
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InvalidInputError(f"{path}: is not a recorded sequence of QPs") from error
    if found != FORMAT:
        raise InvalidInputError(
            f"{path}: is in the format {str(found)[:60]!r}, and {FORMAT!r} is read; record it again"
        )
    return dict(head)


def _kinds(name: str) -> str:
    return {"head": "U", "sizes": "i"}.get(name, "u")


def _runs(sequence: QpSequence) -> Iterator[tuple[Sizes, list[QP]]]:
    """Yield consecutive QPs of equal sizes."""
    for size, run in groupby(sequence.qps, lambda qp: (qp.g.size, qp.b.size, qp.u.size)):
        yield size, list(run)


def _shape(field: str, n: int, me: int, mi: int) -> tuple[int, ...]:
    return {
        "P": (n, n), "A": (me, n), "C": (mi, n), "b": (me,), "l": (mi,), "u": (mi,)
    }.get(field, (n,))  # fmt: skip


def _packed(values: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return rows (k, size) as bytes: differences of bits, bytes of equal weight side by side."""
    bits = np.ascontiguousarray(values, dtype=np.float64).view(np.uint64)
    changed = bits.copy()
    changed[1:] ^= bits[:-1]
    return changed.reshape(-1, 1).view(np.uint8).T.ravel()


def _unpacked(data: NDArray[np.uint8], count: int) -> NDArray[np.float64]:
    """Return the rows (k, size) of bytes."""
    changed = np.ascontiguousarray(data.reshape(8, -1).T).view(np.uint64).reshape(count, -1)
    return np.bitwise_xor.accumulate(changed, axis=0).view(np.float64)
