"""Fitted shapes kept on disk, named by the content they were fitted to.

Where: the folder that the environment variable ``WBC_CACHE`` names; ``off`` turns the cache off; by
default the platform's folder for caches. A file that cannot be read, or does not hold every point
it should, is fitted again; a folder that cannot be written to is left alone.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from wbc.robot.collision.fitting import Fit, contains
from wbc.robot.collision.shapes import Capsule, Hull, Solid
from wbc.validate import Array

VARIABLE = "WBC_CACHE"
OFF = ("", "0", "off", "none")
VERSION = 2  # of the fit and of the file: change it, and everything is fitted again


def cache_folder() -> Path | None:
    """Return the folder of fitted shapes, which need not exist, or None if the cache is off."""
    given = os.environ.get(VARIABLE)
    if given is not None:
        return None if given.strip().lower() in OFF else Path(given).expanduser() / "shapes"
    return _platform_folder() / "wbc" / "shapes"


def _platform_folder() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def cached_fit(kind: str, fit: Callable[[Array], Fit], points: Array) -> Fit:
    """Return ``fit(points)``, from the cache if it was made before.

    Parameters
    ----------
    kind:
        Names the fit and its settings.
    """
    folder = cache_folder()
    if folder is None:
        return fit(points)
    file = folder / f"{_name(kind, points)}.json"
    found = _read(file, points)
    if found is None:
        found = fit(points)
        _write(file, found)
    return found


def _name(kind: str, points: Array) -> str:
    content = hashlib.sha256(f"{VERSION} {kind} {points.shape} ".encode())
    content.update(np.ascontiguousarray(points, dtype="<f8").tobytes())
    return content.hexdigest()


def _read(file: Path, points: Array) -> Fit | None:
    """Return the fit in a file, or None if there is none, or it is not one of these points."""
    try:
        entry = json.loads(file.read_text(encoding="utf-8"))
        core = np.array(entry["core"], dtype=float)
        radius, bulge = float(entry["radius"]), float(entry["bulge"])
        shape = _shape(entry["shape"], core, radius)
        sound = np.isfinite([radius, bulge]).all() and np.isfinite(core).all()
        if not sound or radius < 0.0 or not contains(shape, points):
            return None
    except (OSError, ValueError, KeyError, TypeError, RuntimeError):  # RuntimeError: from Qhull
        return None
    return Fit(shape, bulge)


def _shape(kind: str, core: Array, radius: float) -> Solid:
    if kind == "capsule" and core.shape == (2, 3):
        return Capsule(core, radius)
    if kind == "hull" and core.ndim == 2 and core.shape[1] == 3 and len(core) >= 4:
        return Hull(core, radius)
    raise ValueError(f"no shape: {kind!r} of {core.shape}")


def _write(file: Path, fit: Fit) -> None:
    """Write a fit so that a reader finds all of it or nothing; without a place to write, do not."""
    shape = fit.shape
    kind = "capsule" if isinstance(shape, Capsule) else "hull"
    entry = {"shape": kind, "core": shape.core.tolist(), "radius": shape.radius, "bulge": fit.bulge}
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, suffix=".part")
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            json.dump(entry, stream)
        os.replace(name, file)
