"""Text files of OpenSim: marker positions (TRC), and force plates (MOT, STO)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from wbc.human.markers import ForcePlate, MarkerRecording, without_copies
from wbc.motion.table import RecordingError, cell_numbers, numbers_of, read_text, shortened
from wbc.validate import Array

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "meters": 1.0, "millimeters": 1e-3}
MAX_MARKERS = 1000
MIN_FORCE = 10.0  # N: below it a plate's CoP is noise, and its force is set to 0
# m, of points from the origin, and of free torques by the force: what is larger is in (N) mm.
MAX_POINT, MAX_FREE_ARM = 20.0, 0.5
ABOUT_ORIGIN = 0.1  # of a force's level moment about the origin: a torque no further off is that
_COLUMN, _WORD = re.compile("(.*?)_?([vpm]?)([xyz])"), re.compile("_?(force|torque|moment)")


def read_trc(path: Path) -> MarkerRecording:
    """Return the recording of a TRC file.

    Empty cells, and markers at exactly (0, 0, 0), count as not seen.

    Raises RecordingError: unreadable, no such header, an unknown unit, or a row that does not fit.
    """
    source, lines = str(path), read_text(path, strict=False).splitlines()
    if len(lines) < 6 or not lines[0].startswith("PathFileType"):
        raise RecordingError("it does not begin as a TRC file does (PathFileType ...)", source)
    if "\t" not in lines[3] and "," in lines[3]:  # as spreadsheets write it
        lines = [line.replace(",", "\t") for line in lines]
    fields = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    unit = fields.get("Units", "").lower()
    if unit not in UNITS:
        raise RecordingError(f"Units: expected mm, cm or m, got {shortened(unit)!r}", source)
    labels = [cell.strip() for cell in _cells(lines[3])[2:] if cell.strip()]
    if not labels or len(labels) > MAX_MARKERS:
        raise RecordingError(f"line 4 names {len(labels)} markers", source)
    notes = list[str]()
    text = fields.get("NumMarkers", "")
    declared = int(text) if text.isdigit() and int(text) <= MAX_MARKERS else len(labels)
    if declared != len(labels):
        notes.append(f"the header declares {declared} markers, {len(labels)} are named")
    # Cortex writes those without a name behind the others, in some frames more than declared.
    rows = _rows(lines, 5, 2 + 3 * len(labels), source, unnamed=declared > len(labels))
    notes += _cut_off(fields.get("NumFrames", ""), len(rows))
    positions = rows[:, 2:].reshape(len(rows), -1, 3) * UNITS[unit]
    zero = (positions == 0.0).all(axis=2)
    if zero.any():
        positions[zero] = np.nan
        notes.append(f"{int(zero.sum())} positions at exactly 0, 0, 0 were taken as not seen")
    if not np.isfinite(rows[:, 1]).all():
        raise RecordingError("a row has no time", source, "Time")
    distinct, columns, repeated = without_copies(labels, positions)
    return MarkerRecording(
        rows[:, 1], distinct, positions[:, columns], source=source, notes=(*notes, *repeated)
    )


def _cut_off(declared: str, count: int) -> list[str]:
    """Return a note if a header declares another number of rows than there is."""
    what = f"the header declares {declared} rows, {count} are there: it is an excerpt, or cut off"
    return [what] if declared.isdigit() and declared != str(count) else []


def _rows(lines: list[str], first: int, width: int, source: str, unnamed: bool = False) -> Array:
    """Return the numbers of a table's lines (n, width), NaN where a cell is empty or missing.

    With ``unnamed`` cells behind the named ones are left out.
    """
    found = list[list[float]]()
    for number, line in enumerate(lines[first:], first + 1):
        if not line.strip():
            continue
        cells = _cells(line)
        cells = cells[:width] if unnamed else cells
        for end in (-1, 0):
            while len(cells) > width and not cells[end].strip():
                cells.pop(end)
        if len(cells) > width:
            what = f"it has {len(cells)} cells, the header has {width}"
            raise RecordingError(what, source, None, len(found) + 1, number)
        row = cell_numbers(cells, source, len(found) + 1, number)
        found.append(row + [np.nan] * (width - len(row)))
    return numbers_of(found, source)


def _cells(line: str) -> list[str]:
    """Split at tabs; or at blanks, if two of them in a row separate cells between tabs."""
    blank = "\t" not in line or re.search("[^\t ] {2,}[^\t ]", line) is not None
    return line.split() if blank else line.split("\t")


def read_plates(path: Path) -> tuple[tuple[ForcePlate, ...], tuple[str, ...]]:
    """Return the force plates of an OpenSim MOT or STO file, and notes.

    Columns ``..._vx`` to ``..._vz`` are the force, ``..._px`` to ``..._pz`` its point, and those
    with ``torque`` or ``moment`` in their names the torque there (or about the origin, which is
    noted), in N, m and N m, or in mm and N mm, as OpenSim's reader of C3D files gives them. Points
    and torques of an unloaded plate may be missing.

    Raises RecordingError: unreadable, no such header, no forces, a force without its point, or
    missing numbers.
    """
    source, lines = str(path), read_text(path, strict=False).splitlines()
    end = next((k for k, line in enumerate(lines[:200]) if line.strip() == "endheader"), None)
    if end is None or end + 2 > len(lines):
        raise RecordingError("it has no line 'endheader', as MOT and STO files have", source)
    head = next((k for k in range(end + 1, len(lines)) if lines[k].strip()), end)
    names = [name.lower() for name in lines[head].split()]
    if names[0] != "time":
        raise RecordingError("its first column is not time", source)
    rows = _rows([line.replace("\t", " ") for line in lines], head + 1, len(names), source)
    if not np.isfinite(rows[:, 0]).all() or not (np.diff(rows[:, 0]) > 0.0).all():
        raise RecordingError("times must increase from row to row", source, "time")
    columns = _by_plate(names)
    if not columns:
        raise RecordingError("no force is in it: three columns such as ground_force_vx", source)
    declared = re.search("^(?:nRows|datarows)[ =]+([0-9]+)", "\n".join(lines[:end]), re.MULTILINE)
    plates, notes = list[ForcePlate](), _cut_off(declared[1] if declared else "", len(rows))
    for plate, found in columns.items():
        if "p" not in found:
            what = f"{plate} has no point: three columns such as {plate}_px are needed"
            raise RecordingError(what, source)
        force, point, torque = (
            rows[:, found[kind]] if kind in found else np.zeros((len(rows), 3)) for kind in "vpt"
        )
        loaded = ~(np.linalg.norm(force, axis=1) <= MIN_FORCE)
        missing = loaded & ~np.isfinite(np.hstack((force, point, torque))).all(axis=1)
        if missing.any():
            row = int(np.flatnonzero(missing)[0]) + 1
            raise RecordingError(f"a number of {plate} is missing", source, None, row)
        if loaded.any() and np.median(np.linalg.norm(point[loaded], axis=1)) > MAX_POINT:
            point = 1e-3 * point
            arms = np.linalg.norm(torque[loaded], axis=1) / np.linalg.norm(force[loaded], axis=1)
            torque = (1e-3 if np.median(arms) > MAX_FREE_ARM else 1.0) * torque
            notes.append(f"points of {plate} are taken for mm: in m they would be far away")
        force = np.where(loaded[:, None], force, 0.0)
        moment = np.where(loaded[:, None], np.cross(point, force), 0.0)
        torque = np.where(loaded[:, None], torque, 0.0)
        # The torque at a CoP has no level components; that about the origin has the moment's.
        level = np.delete((moment, torque), np.abs(force).sum(axis=0).argmax(), axis=2)
        if np.linalg.norm(level[1] - level[0]) < ABOUT_ORIGIN * np.linalg.norm(level[0]):
            notes.append(f"torques of {plate} are taken about the origin, not at its points")
            moment = torque
        else:
            moment = moment + torque
        plates.append(ForcePlate(plate, rows[:, 0], force, moment))
    return tuple(plates), tuple(notes)


def _by_plate(names: list[str]) -> dict[str, dict[str, list[int]]]:
    """Return columns x, y, z of force v, point p and torque t by plate; those that have a force.

    Names have the word force, torque or moment (``ground_moment_1_mx``), or are a plate's with a
    force and a point (``FP1_vx``, ``FP1_px``); torques may also be ``ground_force_1_mx``.
    """
    found, called = dict[str, dict[str, list[int]]](), dict[str, str]()
    for k, name in enumerate(names):
        match = _COLUMN.fullmatch(name)
        if match is None:
            continue
        stem, letter, axis = match.groups()
        turns = letter == "m" or "torque" in stem or "moment" in stem
        kind = "t" if turns else letter
        if kind in ("v", "p", "t"):
            plate = _WORD.sub("", stem)
            found.setdefault(plate, {}).setdefault(kind, [-1, -1, -1])["xyz".index(axis)] = k
            if kind == "v":
                called[plate] = stem
    whole = {
        called.get(plate, plate): {kind: c for kind, c in kinds.items() if -1 not in c}
        for plate, kinds in found.items()
    }
    return {n: c for n, c in whole.items() if "v" in c and ("force" in n or "p" in c)}
