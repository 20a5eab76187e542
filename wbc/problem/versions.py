"""Versions of what a result was made with."""

from __future__ import annotations

import platform
from importlib import metadata

from wbc import __version__

PACKAGES = ("numpy", "pin", "proxsuite", "qpsolvers")


def versions() -> dict[str, str]:
    """Return the versions of this package, of Python and of what a result depends on."""
    return {
        "wbc": __version__,
        "python": platform.python_version(),
        **{name: version_of(name) for name in PACKAGES},
    }


def version_of(package: str) -> str:
    """Return the version of an installed package, or ``not installed``."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"
