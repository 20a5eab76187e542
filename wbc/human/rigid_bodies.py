"""Trajectories of rigid bodies in a CSV file, as markers at a human's joints and on its bones.

Two layouts: exports of OptiTrack's Motive (a head of several rows, bones or rigid bodies with
quaternions, in the world's axes), and a plain table, ``time`` and for each body ``NAME_x``,
``NAME_y``, ``NAME_z`` [m], ``NAME_qx``, ``NAME_qy``, ``NAME_qz``, ``NAME_qw``.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.human.bones import Bone, bone_markers, joint_landmarks
from wbc.human.markers import MarkerRecording
from wbc.motion.table import RecordingError, cell_numbers, numbers_of, read_text, shortened
from wbc.validate import Array

MOTIVE = "Format Version"
PARTS = ("qx", "qy", "qz", "qw", "x", "y", "z")
UNITS = {"meters": 1.0, "centimeters": 0.01, "millimeters": 0.001}
MIN_BODIES = 6  # hips, knees and ankles
MAX_BODIES, HEAD_ROWS, SNIFFED_BYTES = 500, 12, 65536
NORM_TOLERANCE = 0.05  # of a quaternion's norm
MAX_LENGTH_DEVIATION = 0.02  # m, standard deviation of a bone's length
SEGMENTS = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))


class _Body(NamedTuple):
    name: str
    columns: tuple[int, ...]  # of PARTS


def is_rigid_bodies(path: Path) -> bool:
    """Return whether a CSV file has trajectories of rigid bodies, by its first lines."""
    try:
        with path.open("rb") as file:
            text = file.read(SNIFFED_BYTES).decode("utf-8-sig", errors="replace")
    except OSError:
        return False  # its reader tells why
    first = next(iter(text.splitlines()), "")
    return first.startswith(MOTIVE) or len(_plain_bodies(_cells(first))) >= MIN_BODIES


def read_rigid_bodies(path: Path) -> MarkerRecording:
    """Return rigid bodies of a CSV file as markers at joints and on bones.

    Bodies are identified by name, as joints of a BVH, and their origins are taken for the joints'
    centres. Empty cells are gaps.

    Raises RecordingError: unreadable, none of these layouts, rotations that are no quaternions of
    the world's axes, an unknown unit, or no human's bodies.
    """
    source = str(path)
    lines = read_text(path, strict=False).splitlines()
    if lines and lines[0].startswith(MOTIVE):
        bodies, time, first, scale, note = _motive(lines, source)
    else:
        head = _cells(lines[0]) if lines else []
        bodies = _plain_bodies(head)
        if len(bodies) < MIN_BODIES or "time" not in head:
            raise RecordingError(
                "its first line names no rigid bodies of a human: expected time, and of each"
                " NAME_x, NAME_y, NAME_z, NAME_qx, NAME_qy, NAME_qz, NAME_qw",
                source,
            )
        time, first, scale, note = head.index("time"), 1, 1.0, "lengths taken for m"
    if len(bodies) > MAX_BODIES:
        raise RecordingError(f"over {MAX_BODIES} rigid bodies", source)
    values = _numbers(lines, first, source)
    width = values.shape[1]
    if time >= width or any(max(body.columns) >= width for body in bodies):
        raise RecordingError("its rows are shorter than its head", source)
    landmarks = joint_landmarks([body.name for body in bodies], source)
    notes, bones = [note], list[Bone]()
    for k, body in enumerate(bodies):
        place, R = _poses(values[:, list(body.columns)], body.name, source)
        bones.append(Bone(body.name, scale * place, R, landmarks.get(k)))
    owners = [bone.name.rpartition(":")[0] for bone in bones]
    for one in dict.fromkeys(owners):
        notes += _length_notes(
            [bone for bone, owner in zip(bones, owners, strict=True) if owner == one]
        )
    if not np.isfinite(values[:, time]).all():
        raise RecordingError("a time is no number", source)
    return bone_markers(values[:, time], bones, source, tuple(notes))


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line]), [])]


def _plain_bodies(head: Sequence[str]) -> list[_Body]:
    """Return the bodies of a plain table with all of their columns."""
    at = {name: k for k, name in enumerate(head)}
    names = [name.removesuffix("_qw") for name in head if name.endswith("_qw")]
    found = list[_Body]()
    for name in names:
        columns = [at.get(f"{name}_{part}") for part in PARTS]
        if None not in columns:
            found.append(_Body(name, tuple(k for k in columns if k is not None)))
    return found


def _motive(lines: Sequence[str], source: str) -> tuple[list[_Body], int, int, float, str]:
    """Return bodies, the time's column, the first row of numbers, the unit [m], and a note."""
    facts = _cells(lines[0])
    header = dict(zip(facts[::2], facts[1::2], strict=False))
    kind, space = header.get("Rotation Type", ""), header.get("Coordinate Space", "")
    if kind.lower() != "quaternion" or space.lower() != "global":
        raise RecordingError(
            f"its rotations are {shortened(kind)!r}, its axes {shortened(space)!r}; export"
            " quaternions, and the global coordinate space",
            source,
        )
    unit = header.get("Length Units", "")
    if unit.lower() not in UNITS:
        what = f"lengths in {shortened(unit)!r}; expected {', '.join(UNITS)}"
        raise RecordingError(what, source)
    rows = [_cells(line) for line in lines[1:HEAD_ROWS]]
    last = next((k for k, row in enumerate(rows) if row[:1] == ["Frame"]), None)
    named = next((row for row in rows if row[1:2] == ["Name"]), None)
    types = next((row for row in rows if row[1:2] == ["Type"] or "Bone" in row[2:]), None)
    if last is None or named is None or last == 0:
        raise RecordingError("its head has no rows Name and Frame, as Motive's has", source)
    kinds, axes = rows[last - 1], rows[last]
    columns = dict[str, dict[str, int]]()
    for k in range(2, min(len(named), len(kinds), len(axes))):
        if types is not None and types[k : k + 1] not in (["Bone"], ["Rigid Body"]):
            continue  # a marker of a body
        part = axes[k].lower()
        key = f"q{part}" if kinds[k] == "Rotation" else part
        if kinds[k] in ("Rotation", "Position") and key in PARTS:
            columns.setdefault(named[k], {}).setdefault(key, k)
    bodies = [
        _Body(name, tuple(own[part] for part in PARTS))
        for name, own in columns.items()
        if len(own) == len(PARTS)
    ]
    return bodies, 1, last + 2, UNITS[unit.lower()], f"lengths in {unit.lower()}, as its head says"


def _numbers(lines: Sequence[str], first: int, source: str) -> Array:
    """Return the rows of numbers; NaN where a cell is empty."""
    found = list[list[float]]()
    for number, cells in enumerate(csv.reader(lines[first:]), first + 1):
        if not any(cells):
            continue
        if found and len(cells) != len(found[0]):
            what = f"it has {len(cells)} cells, the first row {len(found[0])}"
            raise RecordingError(what, source, None, len(found) + 1, number)
        found.append(cell_numbers(cells, source, len(found) + 1, number))
    return numbers_of(found, source)


def _poses(values: Array, name: str, source: str) -> tuple[Array, Array]:
    """Return positions (n, 3) and rotations (n, 3, 3) of a body; NaN where it was not seen."""
    seen = np.isfinite(values).all(axis=1)
    place, R = np.full((len(values), 3), np.nan), np.full((len(values), 3, 3), np.nan)
    if seen.any():
        norm = np.linalg.norm(values[seen, :4], axis=1)
        worst = int(np.abs(norm - 1.0).argmax())
        if abs(norm[worst] - 1.0) > NORM_TOLERANCE:
            row, size = int(np.flatnonzero(seen)[worst]) + 1, norm[worst]
            what = f"the quaternion of {shortened(name)!r} has norm {size:.3g} in row {row}"
            raise RecordingError(what, source)
        R[seen] = Rotation.from_quat(values[seen, :4]).as_matrix()
        place[seen] = values[seen, 4:]
    return place, R


def _length_notes(bones: Sequence[Bone]) -> list[str]:
    """Return notes of bones whose length varies, so that their ends are no joint centres."""
    at = {bone.landmark: bone.place for bone in bones if bone.landmark is not None}
    notes = list[str]()
    for side, (one, other) in product(("left", "right"), SEGMENTS):
        start, end = (at.get(f"{side}_{name}_centre") for name in (one, other))
        if start is None or end is None:
            continue
        length = np.linalg.norm(start - end, axis=1)
        spread = float(np.nanstd(length)) if np.isfinite(length).any() else 0.0
        if spread > MAX_LENGTH_DEVIATION:
            notes.append(
                f"the distance of {side} {one} and {other} varies by +- {1e3 * spread:.0f} mm:"
                " the bodies' origins are no joints"
            )
    return notes
