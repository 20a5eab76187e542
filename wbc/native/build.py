"""The core compiled by the system's C compiler into the user's cache, once for each content.

A build is a folder named by a hash of sources, flags, compiler and machine, with the library and
its checksum in it. It appears by one rename: a reader finds all of it or nothing, and of processes
that build at once the first wins. A build whose checksum does not match, or that cannot be loaded
since it is another machine's, is made anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from wbc.errors import WbcError
from wbc.files import CACHE_VARIABLE, cache_folder
from wbc.native.fingerprint import FLAGS, SOURCE, fingerprint

COMPILERS = ("cc", "gcc", "clang")
LONGEST = 120.0  # s for the compiler; it takes one or two
LIBRARY, CHECKSUM = "core.so", "core.sha256"


class NativeCoreError(WbcError):
    """The native core was required, and cannot be had; the message says why."""


def built(anew: bool = False) -> Path:
    """Return the compiled library, made now unless it is in the cache.

    Parameters
    ----------
    anew:
        Make it in any case: what is in the cache cannot be loaded.

    Raises
    ------
    NativeCoreError
        No compiler, one that fails, or no folder to keep the library in that is the user's own.
    """
    if os.name != "posix":
        raise NativeCoreError(f"the native core is not built on {sys.platform}")
    compiler = find_compiler()
    folder = _own_folder()
    place = folder / _key(compiler)
    if anew or not _intact(place):
        shutil.rmtree(place, ignore_errors=True)
        _build(compiler, place)
        if not _intact(place):
            raise NativeCoreError(f"what was compiled into {place} was changed meanwhile")
    return place / LIBRARY


def find_compiler() -> list[str]:
    """Return the command of the C compiler: ``CC`` of the environment, or the system's.

    Raises
    ------
    NativeCoreError
        There is none.
    """
    given = os.environ.get("CC", "").strip()
    try:
        command = shlex.split(given)
    except ValueError as error:
        raise NativeCoreError(f"CC={given!r} cannot be read: {error}") from error
    for name in command[:1] or COMPILERS:
        found = shutil.which(name)
        if found is not None:
            return [found, *command[1:]]
    wanted = f"CC={given!r} is not found" if given else f"no C compiler ({', '.join(COMPILERS)})"
    raise NativeCoreError(f"{wanted}; install one, such as gcc")


def _key(compiler: list[str]) -> str:
    """Return the name of the build: a hash of all that decides what comes out."""
    executable = Path(compiler[0]).resolve()
    there = executable.stat()
    machine = (sys.platform, platform.machine())
    made_by = (str(executable), there.st_size, there.st_mtime_ns, compiler[1:], FLAGS)
    return _checksum(repr((machine, made_by, fingerprint())).encode())[:32]


def _own_folder() -> Path:
    """Return the folder of builds, which nobody else may write to: what lies there is run."""
    folder = cache_folder("native")
    if folder is None:
        raise NativeCoreError(f"{CACHE_VARIABLE}=off leaves no place to keep what is compiled")
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        there = folder.stat()
    except OSError as error:
        raise NativeCoreError(f"no folder for what is compiled: {error}") from error
    if there.st_uid != os.geteuid() or there.st_mode & 0o022:
        raise NativeCoreError(f"{folder} can be written to by others; what lies there is not run")
    return folder


def _intact(place: Path) -> bool:
    """Whether a build is whole and as it was made."""
    try:
        content = (place / LIBRARY).read_bytes()
        return (place / CHECKSUM).read_text(encoding="ascii") == _checksum(content)
    except (OSError, ValueError):
        return False


def _checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _build(compiler: list[str], place: Path) -> None:
    """Compile beside ``place`` and rename."""
    try:
        beside = Path(tempfile.mkdtemp(dir=place.parent, prefix=".part-"))
    except OSError as error:
        raise NativeCoreError(f"the cache cannot be written to: {error}") from error
    try:
        _compile(compiler, beside / LIBRARY)
        checksum = _checksum((beside / LIBRARY).read_bytes())
        (beside / CHECKSUM).write_text(checksum, encoding="ascii")
        with contextlib.suppress(OSError):  # another process was faster
            beside.rename(place)
    except OSError as error:
        raise NativeCoreError(f"the cache cannot be written to: {error}") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _compile(compiler: list[str], library: Path) -> None:
    sources = [str(file) for file in sorted(SOURCE.glob("*.c"))]
    flags = (*FLAGS, "-fPIC", "-shared", f'-DWBC_SOURCE="{fingerprint()}"')
    command = [*compiler, *flags, "-o", str(library), *sources, "-lm"]
    called = Path(compiler[0]).name
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=LONGEST, check=False, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired as error:
        raise NativeCoreError(f"{called} was not done after {LONGEST:g} s") from error
    except OSError as error:
        raise NativeCoreError(f"{called} cannot be run: {error}") from error
    if done.returncode != 0 or not library.is_file():
        said = done.stderr.decode(errors="replace").strip().splitlines() or ["nothing"]
        raise NativeCoreError(
            f"{called} could not compile the core (exit code {done.returncode}); it said: "
            f"{said[0][:300]}"
        )
