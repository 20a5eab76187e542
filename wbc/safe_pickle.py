"""Pickles of this package's objects that run no code but the package's when read.

A pickle can name any function to be called while it is read. Here it may name classes of this
package, arrays, and what robots are made of; whatever else it names is refused, unless its
source file was given.
"""

from __future__ import annotations

import importlib.util
import io
import json
import pickle
import platform
import zlib
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from wbc import __version__
from wbc.errors import InvalidInputError
from wbc.files import system_message, write_whole
from wbc.kinds import check_path

LARGEST = 500_000_000  # bytes unpacked
_PLAIN = {
    "builtins": {"bytearray", "complex", "frozenset", "object", "range", "set", "slice"},
    "collections": {"OrderedDict", "deque"},
    "copyreg": {"_reconstructor"},
    "functools": {"partial"},  # of what may be named itself
    "operator": {"itemgetter"},
    "numpy": {"dtype", "ndarray"},
    "pathlib": {"Path", "PosixPath", "PurePosixPath", "WindowsPath"},
    "numpy._core.multiarray": {"_reconstruct", "scalar"},
    "numpy.core.multiarray": {"_reconstruct", "scalar"},
    "numpy._core.numeric": {"_frombuffer"},
    "numpy.core.numeric": {"_frombuffer"},
}
_ROBOTICS = ("coal", "pinocchio")  # packages whose classes robots are made of
_SCRIPT = "__main__"


def made_with() -> dict[str, str]:
    """Return the versions on which results depend bit for bit."""
    return {"wbc": __version__, "numpy": np.__version__, "python": platform.python_version()}


def write_pickled(path: str | Path, kind: str, content: Any) -> None:
    """Write a line of JSON that names the kind, then ``content``, atomically.

    ``kind``: what it is, such as ``"wbc tick 1"``.

    Raises InvalidInputError: something in it cannot be pickled, such as a task of yours that holds
    an open file; or this is no path; OSError: the file cannot be written.
    """
    check_path("file to write", path)
    try:
        packed = zlib.compress(pickle.dumps(content, protocol=5))
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError) as error:
        reason = system_message(error)[:200]
        what = f"{path}: cannot be written, a part of it is not plain data ({reason})"
        raise InvalidInputError(f"{what}; parts of yours must be picklable") from error
    head = json.dumps({"format": kind, "versions": made_with()}).encode()
    write_whole(path, lambda file: file.write(head + b"\n" + packed))


def kind_of(path: str | Path) -> str | None:
    """Return the kind that a file declares, or None if it is not such a file.

    Raises OSError: it cannot be read.
    """
    with open(path, "rb") as file:
        head = _head(file.readline(2000))
    return None if head is None else str(head["format"])


def read_pickled(
    path: str | Path, kind: str, code: Path | None = None
) -> tuple[Any, dict[str, str]]:
    """Return the content of a file of :func:`write_pickled`, and the versions that wrote it.

    ``code``: a Python file that defines classes of yours which are in it; it is run.

    Raises InvalidInputError: not such a file, damaged, of a version that this one cannot read, or
    it names code that is neither the package's nor in ``code``; OSError: it cannot be read.
    """
    check_path("file to read", path)
    head_line, _, packed = Path(path).read_bytes().partition(b"\n")
    head = _head(head_line)
    if head is None or head["format"] != kind:
        what = f"is a {head['format']!r}" if head else "is no file that this package wrote so"
        raise InvalidInputError(f"{path}: expected a {kind!r}, it {what}")
    versions = {str(name): str(version) for name, version in head["versions"].items()}
    own = None if code is None else _module(code)
    try:
        unpacking = zlib.decompressobj()
        data = unpacking.decompress(packed, LARGEST)
        if unpacking.unconsumed_tail:
            raise InvalidInputError(f"{path}: has more than {LARGEST} bytes unpacked")
        if not unpacking.eof:
            raise InvalidInputError(f"{path}: ends too early; copy it again")
        return _Reader(io.BytesIO(data), str(path), own).load(), versions
    except InvalidInputError:
        raise
    except Exception as error:  # damaged pickles end in whatever their classes raise
        written = ", ".join(f"{name} {version}" for name, version in versions.items())
        raise InvalidInputError(
            f"{path}: cannot be read ({type(error).__name__}: {system_message(error)[:200]});"
            f" it was written by {written}, and this is wbc {__version__}"
        ) from error


def _head(line: bytes) -> dict[str, Any] | None:
    try:
        head = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(head, dict) or not isinstance(head.get("versions"), Mapping):
        return None
    return head if isinstance(head.get("format"), str) else None


def _module(code: Path) -> ModuleType:
    """Run a Python file and return its module."""
    spec = importlib.util.spec_from_file_location(code.stem, code)
    if spec is None or spec.loader is None or not code.is_file():
        raise InvalidInputError(f"--code {code}: is not a Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        what = f"--code {code}: cannot be run ({type(error).__name__}: {error})"
        raise InvalidInputError(what) from error
    return module


class _Reader(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, path: str, own: ModuleType | None) -> None:
        super().__init__(file)
        self._path, self._own = path, own

    def find_class(self, module: str, name: str) -> Any:
        if module == "pathlib._local":  # where Python 3.13 says that paths are, and no other
            module = "pathlib"
        if (module, name) == ("builtins", "getattr"):
            return _maker_of
        if name in _PLAIN.get(module, ()):
            return super().find_class(module, name)
        if module.partition(".")[0] in ("wbc", *_ROBOTICS):
            found = super().find_class(module, name)
            if isinstance(found, type):
                return found
        elif self._own is not None and module in (_SCRIPT, self._own.__name__):
            if hasattr(self._own, name):
                return getattr(self._own, name)
            raise InvalidInputError(f"{self._path}: {name} is not in {self._own.__file__}")
        raise InvalidInputError(
            f"{self._path}: names {module}.{name}, code that is not wbc's; if it is yours, give"
            " the file that defines it: --code FILE.py"
        )


def _maker_of(owner: Any, name: str) -> Any:
    """Return a class's constructor method for ``getattr``: the only ones that pickles may call."""
    if isinstance(owner, type) and owner.__module__.startswith("wbc.") and name.startswith("_with"):
        return getattr(owner, name)
    raise InvalidInputError(f"a pickle asks for {name!r} of {owner!r}, which wbc never writes")
