"""Provenance of a result: versions, the problem's text and its overrides."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib import metadata
from typing import Any

from wbc import __version__
from wbc.problem.source import Source
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
