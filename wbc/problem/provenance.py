"""Provenance of a result: versions, the problem's text and its overrides."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Any

from wbc import __version__
from wbc.errors import ModelError, ProblemFileError
from wbc.files import beside
from wbc.problem.source import Source
from wbc.problem.yaml_reader import STDIN
from wbc.qp.proxqp_workspace import BUILD
from wbc.run.saving import plain

PACKAGES = ("numpy", "pin", "proxsuite", "qpsolvers")


def versions(*more: str) -> dict[str, str]:
    """Return the versions of this package, of Python and of the packages that affect results.

    ``more`` are packages that some results depend on besides.

    Proxsuite's is followed by its build if results of that vary in their last bits
    (:mod:`wbc.qp.proxqp_workspace`).
    """
    found = {
        "wbc": __version__,
        "python": platform.python_version(),
        **{name: version_of(name) for name in (*PACKAGES, *more)},
    }
    found["proxsuite"] += f" ({BUILD})" if BUILD else ""
    return found


def version_of(package: str) -> str:
    """Return the version of an installed package, or ``not installed``."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def provenance(source: Source, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return a problem's file, text and overrides, with which it can be run again."""
    return {"file": source.name, "text": source.text, "overrides": plain(overrides)}


@contextmanager
def files_of(path: Path, name: str) -> Iterator[None]:
    """Where a result's problem ``name`` is not here, say of what does not load where it may be."""
    try:
        yield
    except (ProblemFileError, ModelError) as error:
        if name == STDIN or Path(name).is_absolute() or Path(name).exists():
            raise
        told = f"{path}: {error}; it ran in a folder with {name}: go there, its paths begin there"
        raise type(error)(told) from error


def digests_of_files(data: object, folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file that a text in plain data names, by that text.

    Robots, plans and motions: results depend on them as on the problem. Paths are relative to
    ``folder``, the problem's.
    """
    if isinstance(data, Mapping):
        data = list(data.values())
    if isinstance(data, list | tuple):
        parts = [digests_of_files(one, folder) for one in data]
        return {text: digest for part in parts for text, digest in part.items()}
    if not isinstance(data, str):
        return {}
    try:
        path = beside(folder, data)
        # A device or a pipe, as a word may name, has no end.
        return {data: hashlib.sha256(path.read_bytes()).hexdigest()} if path.is_file() else {}
    except (OSError, ValueError):  # not readable; no path
        return {}
