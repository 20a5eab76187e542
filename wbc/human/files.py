"""Files of recorded humans: the reader by file name."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

from wbc.errors import InvalidInputError
from wbc.human.bvh import read_bvh
from wbc.human.c3d import read_c3d
from wbc.human.markers import ForcePlate, MarkerRecording
from wbc.human.opensim_files import read_plates, read_trc
from wbc.human.rigid_bodies import is_rigid_bodies, read_rigid_bodies
from wbc.human.smpl import is_smpl, read_smpl
from wbc.kinds import check_path
from wbc.motion.table import RecordingError

ENDINGS = (".c3d", ".trc", ".bvh", ".csv", ".npz")
PLATES = (".mot", ".sto", ".c3d")


def is_human_recording(path: str | Path) -> bool:
    """Return whether a file is read as a human's recording.

    C3D, TRC, BVH, a CSV of rigid bodies, or an NPZ of SMPL poses.
    """
    check_path("is_human_recording, path", path)
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".csv":
        return is_rigid_bodies(path)
    if ending != ".npz":
        return ending in ENDINGS
    try:
        with zipfile.ZipFile(path) as file:
            return is_smpl([name.removesuffix(".npy") for name in file.namelist()])
    except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError, RuntimeError):
        return False  # its reader tells what is wrong


def read_markers(
    path: str | Path,
    *,
    forces: str | Path | None = None,
    unit: str | float | None = None,
    stature: float | None = None,
    standing: bool = False,
) -> MarkerRecording:
    """Read a human's recording from a C3D, TRC, BVH or CSV file, or an NPZ of SMPL poses.

    C3D: markers and force plates of types 1 to 4. TRC: markers; force plates from an OpenSim MOT or
    STO file (``forces``). BVH and AMASS-like NPZ: joints and bones of the skeleton. CSV: rigid
    bodies, of OptiTrack's Motive or a plain table (:mod:`wbc.human.rigid_bodies`).

    Parameters
    ----------
    forces:
        File with force plates of the same world and time, ``.mot``, ``.sto`` or ``.c3d``; in place
        of those of the recording.
    unit:
        Of a BVH file's lengths, ``cm``, ``m``, ``inch``, ``mm``, ``cmu`` (Carnegie Mellon's, 56.4
        mm), or its length [m]; None: by the skeleton's legs. Other files tell theirs.
    stature:
        Of the human whose SMPL poses are read [m].
    standing:
        Whether it is a static trial, which may have fewer than 8 frames.

    Raises
    ------
    RecordingError
        A file cannot be read, or is none of these; a unit for one that tells its own.
    InvalidInputError
        Its contents are no recording: see :class:`MarkerRecording`.
    """
    check_path("read_markers, path", path)
    path, source = Path(path), str(path)
    if unit is not None and path.suffix.lower() != ".bvh":
        what = f"unit: only for .bvh; a {path.suffix or 'file'} names its unit, or is in m"
        raise RecordingError(what, source)
    try:
        match path.suffix.lower():
            case ".c3d":
                found = read_c3d(path)
            case ".trc":
                found = read_trc(path)
            case ".bvh":
                found = read_bvh(path, unit)
            case ".csv":
                found = read_rigid_bodies(path)
            case ".npz":
                found = read_smpl(path, stature)
            case _:
                what = f"a human is read from {', '.join(ENDINGS)}"
                raise RecordingError(what, source)
        if not standing:
            found.check_moving()
        if forces is None:
            return found
        plates, notes = _plates(Path(forces))
        return replace(found, plates=plates, notes=found.notes + notes)
    except RecordingError:
        raise
    except InvalidInputError as error:
        raise RecordingError(str(error).removeprefix(f"{source}: "), source) from error


def _plates(path: Path) -> tuple[tuple[ForcePlate, ...], tuple[str, ...]]:
    """Return the force plates of a file, and notes on it."""
    if path.suffix.lower() == ".c3d":
        found = read_c3d(path)
        return found.plates, tuple(f"{path.name}: {note}" for note in found.notes)
    if path.suffix.lower() in PLATES:
        return read_plates(path)
    raise RecordingError(f"force plates are read from {', '.join(PLATES)}", str(path))
