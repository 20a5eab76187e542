"""The build of the package: setuptools', which compiles the core, by Zig where no C compiler is.

``ziglang`` (PyPI, 100 MB) becomes a build requirement there, and is gone after the build.
"""

import os
import shlex
import shutil
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (  # noqa: F401  (hooks that are setuptools' own)
    build_sdist,
    get_requires_for_build_sdist,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

Settings = dict[str, Any] | None
# For all machines of a kind, not for this one alone.
ZIG = f"{shlex.quote(sys.executable)} -m ziglang cc -mcpu=baseline"


class CoreBuildError(RuntimeError):
    """The core cannot be compiled here; the message says what to do."""


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return what setuptools needs, and a compiler if there is none."""
    return build_meta.get_requires_for_build_wheel(config_settings) + _compiler_required()


def get_requires_for_build_editable(config_settings: Settings = None) -> list[str]:
    """Return what setuptools needs, and a compiler if there is none."""
    return build_meta.get_requires_for_build_editable(config_settings) + _compiler_required()


def build_wheel(
    wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None
) -> str:
    """Build the wheel with the core in it."""
    return _compiled(build_meta.build_wheel, wheel_directory, config_settings, metadata_directory)


def build_editable(
    wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None
) -> str:
    """Build the core beside its sources, and the wheel that points there."""
    return _compiled(
        build_meta.build_editable, wheel_directory, config_settings, metadata_directory
    )


def _compiler() -> str | None:
    """Return the compiler's command: CC, Python's own, or the system's; None if there is none."""
    asked = os.environ.get("CC", "").strip()
    for command in (asked, sysconfig.get_config_var("CC") or "", "cc", "gcc", "clang"):
        if command and shutil.which(shlex.split(command)[0]):
            return command
    return None


def _compiler_required() -> list[str]:
    return [] if _compiler() else ["ziglang>=0.13"]


def _compiled(build: Any, *arguments: Any) -> str:
    """Return what a hook of setuptools does, with a compiler that is there."""
    asked, command = os.environ.get("CC", "").strip(), _compiler()
    if asked and command != asked:
        print(f"wbc: CC={asked!r} is not found; the core is compiled by {command or ZIG}")
    if command is None:
        if find_spec("ziglang") is None:
            raise CoreBuildError(
                "wbc's core is C, and there is no C compiler (cc, gcc, clang) here: install one, or"
                " leave --no-build-isolation out (or pip install ziglang first)"
            )
        command = ZIG
    header = Path(sysconfig.get_path("include")) / "Python.h"
    if not header.is_file():
        raise CoreBuildError(
            f"wbc's core is compiled against Python's headers; {header} is missing: install them"
            f" (Debian, Ubuntu: apt install python3.{sys.version_info[1]}-dev; Fedora: dnf install"
            " python3-devel), or take another Python (uv python install)"
        )
    os.environ["CC"] = command
    try:
        return build(*arguments)
    except SystemExit as error:
        raise CoreBuildError(
            f"wbc's core (wbc/native/source) could not be compiled by {command!r}, whose words are"
            " above. Another compiler is chosen by the environment variable CC"
        ) from error
