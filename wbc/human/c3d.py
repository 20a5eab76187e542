"""Markers and force plates of a C3D file (www.c3d.org)."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wbc.errors import InvalidInputError, listed
from wbc.human.anthropometry import MASSES
from wbc.human.c3d_parameters import BLOCK, MIPS, C3dFile, floats, read_c3d_head
from wbc.human.markers import ForcePlate, MarkerRecording, without_copies
from wbc.motion.table import read_bytes
from wbc.validate import Array

LENGTHS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "dm": 0.1}
WORDS = {"met": "m", "mill": "mm", "cent": "cm"}  # which may be cut off
MAX_POINTS = 1000
MAX_RATE = 1e6  # Hz
MIN_SIDE = 1e-3  # m, of a plate
MIN_LOAD = 50.0  # N, of a plate that is used
# m, of a plate's diagonal; m and factor of that, of the distance of loads from its sensor. What is
# beyond has another unit than its file tells, as mm in place of m.
DIAGONALS, MIN_LEVER, MAX_LEVER = (0.02, 20.0), 1e-3, 20.0
CORNER_TOLERANCE = 1.05  # factor: an origin in a corner, as treadmills have it, may be rounded


def read_c3d(path: Path) -> MarkerRecording:
    """Return a C3D file's recording: all points whose residual is not negative, and force plates.

    Intel, DEC and MIPS; integers and floats; plates of types 1 to 4.

    Raises RecordingError: unreadable, not such a file, or one whose header, parameters and data
    contradict each other.
    """
    source = str(path)
    file = read_c3d_head(read_bytes(path), source)
    points, per_frame = file.header[1], file.header[2]
    samples = file.header[9]  # of each channel in a frame
    frames = _frames(file)
    rate = file.number("POINT:RATE", file.rate)
    if not 0.0 < rate <= MAX_RATE:
        raise file.error(f"its rate is {rate:g} frames per second")
    if not 0 < points <= MAX_POINTS:
        raise file.error(f"it has {points} points; at least 1 and at most {MAX_POINTS} are read")
    with np.errstate(all="ignore"):  # points that are not finite were not seen
        marked, analog = _data(file, frames, points, per_frame)
    unit = next(iter(file.texts("POINT:UNITS")), "mm").lower()
    unit = next((short for word, short in WORDS.items() if unit.startswith(word)), unit)
    if unit not in LENGTHS:
        raise file.error(f"POINT:UNITS: expected mm, cm or m, got {unit[:20]!r}")
    positions = marked[:, :, :3] * LENGTHS[unit]
    positions[marked[:, :, 3] < 0.0] = np.nan
    positions[(positions == 0.0).all(axis=2)] = np.nan
    names, markers = _labels(file, points)
    labels, columns, repeated = without_copies(names, positions[:, markers])
    time = np.arange(len(marked)) / rate
    plates, plate_notes = _plates(file, analog, rate, samples, LENGTHS[unit])
    mass = file.number("PROCESSING:BODYMASS", 0.0)  # as Vicon writes it, 0 or 1 if nobody did
    notes = (*repeated, *plate_notes)
    if (first := file.header[3]) > 1:
        notes = (f"its first frame has the number {first}; times begin at 0 there", *notes)
    return MarkerRecording(
        time,
        labels,
        positions[:, markers][:, columns],
        plates,
        source=source,
        notes=notes,
        mass=mass if MASSES[0] <= mass <= MASSES[1] else None,
    )


def _frames(file: C3dFile) -> int:
    """Return the number of frames, which 16-bit words of the header cannot tell for long files."""
    first, last = file.header[3], file.header[4]
    count = last - first + 1
    start, end = (file.numbers(f"TRIAL:ACTUAL_{name}_FIELD").ravel() for name in ("START", "END"))
    if start.size == end.size == 2:
        low = [int(v[0]) % 65536 + 65536 * (int(v[1]) % 65536) for v in (start, end)]
        count = low[1] - low[0] + 1
    declared = file.number("POINT:LONG_FRAMES", file.number("POINT:FRAMES", count)) % 2**32
    if last == 65535 and declared > count:
        count = int(declared)
    if count < 1:
        raise file.error(f"its header declares {count} frames")
    return count


def _data(file: C3dFile, frames: int, points: int, per_frame: int) -> tuple[Array, Array]:
    """Return points (n, m, 4) in the file's unit, with residual, and analog samples (n, k)."""
    start = int(file.number("POINT:DATA_START", 0.0))
    start = start if start > file.data[0] else file.header[8]  # after the parameters, or wrong
    start = BLOCK * (start - 1)
    width = 4 if file.real else 2
    # Some programs' header counts channels, of which each has several readings in a frame.
    every = per_frame * file.header[9]
    fits = start + frames * (4 * points + every) * width <= len(file.data)
    if fits and every > per_frame == file.number("ANALOG:USED", 0.0):
        per_frame = every
    words = 4 * points + per_frame
    wanted = frames * words * width
    if start < BLOCK or start + wanted > len(file.data):
        available = max(0, len(file.data) - start) // (words * width)
        what = f"it should have {frames} frames of {points} points, and has bytes for {available}"
        raise file.error(f"{what}; is it cut off?")
    raw = file.data[start : start + wanted]
    if file.real:
        table = floats(raw, file.processor).reshape(frames, words)
    else:
        dtype = ">i2" if file.processor == MIPS else "<i2"
        table = np.frombuffer(raw, dtype=dtype).astype(np.float64).reshape(frames, words)
    marked = table[:, : 4 * points].reshape(frames, points, 4).copy()
    if not file.real:
        marked[:, :, :3] *= file.scale
    else:
        marked[:, :, 3] = np.where(np.isfinite(marked[:, :, 3]), marked[:, :, 3], -1.0)
    return marked, table[:, 4 * points :]


def _labels(file: C3dFile, points: int) -> tuple[list[str], list[int]]:
    """Return the labels of markers, and their points; angles, forces etc. are no markers."""
    labels = file.texts("POINT:LABELS")
    names = [labels[k] if k < len(labels) and labels[k] else f"*{k + 1}" for k in range(points)]
    other = set[str]()
    for kind in ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS"):
        other |= set(file.texts(f"POINT:{kind}"))
    markers = [k for k, name in enumerate(names) if name not in other]
    return [names[k] for k in markers], markers


def _plates(
    file: C3dFile, analog: Array, rate: float, samples: int, unit: float
) -> tuple[tuple[ForcePlate, ...], tuple[str, ...]]:
    """Return force plates, and notes on those that cannot be read."""
    used = int(file.number("FORCE_PLATFORM:USED", 0.0))
    if used < 1 or samples < 1 or not analog.size:
        return (), ()
    channels, rest = divmod(analog.shape[1], samples)
    if rest:
        raise file.error(f"{analog.shape[1]} analog values in a frame are no {samples} per channel")
    signals = _scaled(file, analog.reshape(-1, channels))
    time = np.arange(len(signals)) / (rate * samples)
    plates, notes = list[ForcePlate](), list[str]()
    for k in range(min(used, 32)):
        try:
            with np.errstate(all="ignore"):  # values that are not finite are refused
                plate, more = _plate(file, k, signals, time, unit)
            plates.append(plate)
            notes += more
        except (InvalidInputError, IndexError, ValueError) as error:
            notes.append(f"force plate {k + 1} was left out: {error}")
    return tuple(plates), (*notes, *_overlap_notes(plates))


def _overlap_notes(plates: list[ForcePlate]) -> list[str]:
    """Return a note on loaded plates that are said to be at the same place."""
    loaded = [one for one in plates if np.abs(one.force).max() > MIN_LOAD]
    same = [
        f"{a.name} and {b.name}"
        for a, b in combinations(loaded, 2)
        if a.corners is not None and b.corners is not None
        if np.linalg.norm(a.corners.mean(axis=0) - b.corners.mean(axis=0)) < MIN_SIDE
    ]
    what = f"force {listed(same, 4)} have the same corners"
    return [f"{what}: all but one are elsewhere, and so is their CoP"] if same else []


def _scaled(file: C3dFile, signals: Array) -> Array:
    count = signals.shape[1]
    gain = file.number("ANALOG:GEN_SCALE", 1.0)
    scale, offset = np.ones(count), np.zeros(count)
    for values, name in ((scale, "ANALOG:SCALE"), (offset, "ANALOG:OFFSET")):
        given = file.numbers(name).ravel(order="F")[:count]
        values[: len(given)] = given
    unsigned = "UNSIGNED" in [text.upper() for text in file.texts("ANALOG:FORMAT")]
    if unsigned:
        offset %= 65536  # parameters are words of 16 bits with a sign
        if not file.real:
            signals = np.where(signals < 0.0, signals + 65536.0, signals)
    with np.errstate(all="ignore"):
        return np.asarray((signals - offset) * scale * gain)


def _plate(
    file: C3dFile, k: int, signals: Array, time: Array, unit: float
) -> tuple[ForcePlate, tuple[str, ...]]:
    kinds = file.numbers("FORCE_PLATFORM:TYPE").ravel(order="F")
    corners = file.numbers("FORCE_PLATFORM:CORNERS")
    origin = file.numbers("FORCE_PLATFORM:ORIGIN")
    channel = file.numbers("FORCE_PLATFORM:CHANNEL")
    if corners.ndim != 3 or origin.ndim != 2 or channel.ndim != 2 or k >= len(kinds):
        raise file.error("its corners, origin or channels are missing")
    kind = int(kinds[k])
    many = 8 if kind == 3 else 6
    columns: NDArray[np.intp] = channel[:many, k].astype(np.intp) - 1
    if len(columns) < many or columns.min() < 0 or columns.max() >= signals.shape[1]:
        raise file.error(f"its channels are not among the {signals.shape[1]} recorded")
    values = signals[:, columns]
    if kind == 4:
        calibration = file.numbers("FORCE_PLATFORM:CAL_MATRIX")
        if calibration.ndim != 3 or calibration.shape[:2] != (6, 6):
            raise file.error("it is of type 4 without a calibration matrix")
        values = values @ calibration[:, :, k].T
    texts = [re.sub("[^a-z]", "", text.lower()) for text in file.texts("ANALOG:UNITS")]
    torque = texts[columns[-1]] if columns[-1] < len(texts) else ""
    arm = {"nmm": 1e-3, "nm": 1.0, "ncm": 1e-2}.get(torque, unit)
    name, places = f"force plate {k + 1}", unit * corners[:, :, k].T
    diagonal = float(np.linalg.norm(places[0] - places[2]))
    size = _thousand(diagonal, *DIAGONALS)
    places, diagonal = size * places, size * diagonal
    sensor, notes = _sensors(name, kind, places, size * unit * origin[:, k])
    loaded = values[np.abs(values[:, 2]) > MIN_LOAD] if kind != 3 else values[:0]
    lever = 1.0
    if len(loaded):  # of the force about the sensor, hardly ever so small or so long
        levers = unit if kind == 1 else arm / np.abs(loaded[:, 2])
        far = float(np.quantile(np.hypot(*loaded[:, 3:5].T) * levers, 0.9))
        lever = _thousand(far, MIN_LEVER, MAX_LEVER * diagonal)
    point, arm = (lever * unit, arm) if kind == 1 else (unit, lever * arm)
    for what, factor in (("corners", size), ("points" if kind == 1 else "moments", lever)):
        if factor != 1.0:
            notes += (f"{name} has its {what} in another unit than told: taken times {factor:g}",)
    force, moment = plate_wrench(kind, values, places, sensor, point, arm)
    if kind in (2, 4) and sensor[:2].any():
        # Instrumented treadmills' origins lead from the surface's middle to the sensor in files of
        # some programs, the other way than the manual's.
        wrench = plate_wrench(kind, values, places, sensor * (-1.0, -1.0, 1.0), point, arm)
        if _part_on(places, *wrench) > 0.5 > _part_on(places, force, moment):
            force, moment = wrench
            notes += (f"{name} is loaded beside itself: its origin is taken the other way round",)
    return ForcePlate(f"plate {k + 1}", time, force, moment, places), notes


def _thousand(size: float, least: float, most: float) -> float:
    """Return the factor 1000, 1 or 0.001 that brings a size into a range; 1 if neither does."""
    return next((f for f in (1.0, 1e3, 1e-3) if least < f * size < most), 1.0)


def _sensors(name: str, kind: int, corners: Array, origin: Array) -> tuple[Array, tuple[str, ...]]:
    """Return the offset of a plate's sensors from its centre (3,) [m], and notes.

    Sensors of type 3 stand under the plate, within its corners; where half their distances are too
    large for it, but fit if exchanged, they are exchanged.
    """
    half = 0.5 * np.array([np.linalg.norm(corners[0] - corners[end]) for end in (1, 3)])
    offset = np.abs(origin[:2])
    inside = bool((offset <= (half if kind == 3 else CORNER_TOLERANCE * half)).all())
    if kind == 1 or (inside and (kind != 3 or offset.min() > 0.0)):
        return origin, ()
    sizes = [f"{1e3 * a:.0f} of {1e3 * b:.0f} mm" for a, b in zip(offset, half, strict=True)]
    what = f"{name} has its sensors {' and '.join(sizes)} from its centre"
    if kind == 3 and offset.min() > 0.0 and (offset[::-1] <= half).all():
        return origin[[1, 0, 2]], (f"{what}: x and y are exchanged",)
    return origin, (f"{what}: its origin or corners are wrong, and so is its CoP",)


def _part_on(corners: Array, force: Array, moment: Array) -> float:
    """Return the part of a plate's loaded samples whose CoP is within its corners."""
    middle, sides = corners.mean(axis=0), corners[[0, 0]] - corners[[1, 3]]
    normal = np.cross(*sides)
    up = force @ normal
    loaded = np.abs(up) > MIN_LOAD * np.linalg.norm(normal)
    about = (moment - np.cross(middle, force))[loaded]
    at = np.cross(normal, about) / up[loaded, None] @ sides.T / (sides**2).sum(axis=1)
    return float((np.abs(at) < 0.5 * CORNER_TOLERANCE).all(axis=1).mean()) if loaded.any() else 0.0


def plate_wrench(
    kind: int, values: Array, corners: Array, origin: Array, unit: float, arm: float
) -> tuple[Array, Array]:
    """Return force [N] and moment about the world's origin [N m], both (k, 3).

    Types of the C3D manual (www.c3d.org): 1 gives force, its point and the free torque; 2
    and 4 force and moment at the sensor; 3 eight forces of sensors in the corners. A plate's x axis
    leads from corners 2, 3 to 1, 4, its y axis from 3, 4 to 1, 2. Whether it is the ground's or the
    foot's force differs from laboratory to laboratory; see :meth:`ForcePlate.pushing`.

    ``kind``: 1 to 4.
    ``values``: channels (k, 6), or (k, 8) of type 3, in N and the unit of their moments.
    ``corners``: (4, 3) in the world [m].
    ``origin``: (3,) [m]: from the sensor to the middle of the surface in the plate's axes; of type
    3 half the distances between sensors, and the same.
    ``unit``, ``arm``: of points of type 1, and of moments, in m and N m.

    Raises InvalidInputError: another type, numbers that are not finite, or corners that span
    nothing.
    """
    if kind not in (1, 2, 3, 4):
        raise InvalidInputError(
            f"its type is {kind}; types 1 to 4 are read: export its forces to an MOT file, and give"
            " that as forces"
        )
    if not (np.isfinite(values).all() and np.isfinite(corners).all() and np.isfinite(origin).all()):
        raise InvalidInputError("its numbers are not finite")
    x = 0.5 * (corners[0] + corners[3] - corners[1] - corners[2])
    y = 0.5 * (corners[0] + corners[1] - corners[2] - corners[3])
    z = np.cross(x, y)
    if min(np.linalg.norm(x), np.linalg.norm(y)) < MIN_SIDE or np.linalg.norm(z) < MIN_SIDE**2:
        raise InvalidInputError("its corners span no surface")
    x = x / np.linalg.norm(x)
    z = z / np.linalg.norm(z)
    R = np.column_stack((x, np.cross(z, x), z))
    # The sensor is below the surface and z points down: some files have the other sign.
    offset = np.array((origin[0], origin[1], -abs(origin[2])))
    if kind == 1:
        offset[:] = 0.0
        force = values[:, :3]
        point = np.column_stack((unit * values[:, 3:5], np.zeros(len(values))))
        free = np.column_stack((np.zeros((len(values), 2)), arm * values[:, 5]))
        moment = np.cross(point, force) + free
    elif kind == 3:
        force, moment = _of_corners(values, abs(origin[0]), abs(origin[1]))
        offset[:2] = 0.0
    else:
        force, moment = values[:, :3], arm * values[:, 3:6]
    force = force @ R.T
    return force, moment @ R.T + np.cross(corners.mean(axis=0) - R @ offset, force)


def _of_corners(values: Array, a: float, b: float) -> tuple[Array, Array]:
    """Return force and moment (k, 3) of eight sensors: x12 x34 y14 y23 z1 z2 z3 z4."""
    x12, x34, y14, y23, z1, z2, z3, z4 = values.T
    force = np.column_stack((x12 + x34, y14 + y23, z1 + z2 + z3 + z4))
    about_x, about_y = b * (z1 + z2 - z3 - z4), a * (-z1 + z2 + z3 - z4)
    about_z = b * (-x12 + x34) + a * (y14 - y23)
    return force, np.column_stack((about_x, about_y, about_z))
