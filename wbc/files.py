"""Files: atomic writing, the cache, and safe reading of arrays from untrusted files."""

from __future__ import annotations

import errno
import io
import math
import os
import tempfile
import zipfile
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray
from platformdirs import user_cache_path

from wbc.errors import InvalidInputError
from wbc.kinds import check_path

CACHE_VARIABLE = "WBC_CACHE"
OFF = ("", "0", "off", "none")
CACHED = "collision"  # the folder in it
_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ENCRYPTED = 0x1  # flag of a zip entry
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


class ArrayFileError(InvalidInputError):
    """An NPZ file cannot be read: ``what`` is wrong, in the array ``name`` unless that is None."""

    def __init__(self, path: str | Path, what: str, name: str | None = None) -> None:
        self.what, self.name = what, name
        super().__init__(f"{path}: {what if name is None else f'array {name[:60]!r}: {what}'}")


def beside(folder: Path, name: str | Path) -> Path:
    """Return the path of a file that a file in ``folder`` names; ``~`` is a user's home, if any."""
    return folder / os.path.expanduser(name)


def cache_folder() -> Path | None:
    """Return the cache folder of robots' collision shapes, which need not exist; None if off.

    It is inside the folder that the environment variable ``WBC_CACHE`` names (``off``: no cache),
    by default inside the platform's folder for caches.
    """
    given = os.environ.get(CACHE_VARIABLE)
    if given is not None:
        return None if given.strip().lower() in OFF else beside(Path(), given) / CACHED
    return user_cache_path("wbc", appauthor=False) / CACHED


def ending_of(path: str | Path, endings: Collection[str], expected: str) -> str:
    """Return the ending of a file's name, in small letters."""
    check_path("file to write", path)
    ending = Path(path).suffix.lower()
    if ending not in endings:
        raise InvalidInputError(f"{path}: {expected}")
    return ending


def write_whole(path: str | Path, fill: Callable[[IO[bytes]], object]) -> None:
    """Write a file atomically: a temporary file in the same folder is renamed.

    ``fill``: called with the open binary file.

    Raises OSError: the file cannot be written; an existing one is unchanged. The error names the
    file, not the temporary one.
    """
    path = Path(path)
    try:
        # A name is at most 255 bytes, of which the file's own may be all.
        handle, neighbour = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:40]}.")
        try:
            with os.fdopen(handle, "wb") as file:
                fill(file)
            mask = os.umask(0)  # which can only be read by setting it
            os.umask(mask)
            Path(neighbour).chmod(0o666 & ~mask)
            Path(neighbour).replace(path)
        except BaseException:
            Path(neighbour).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OSError(error.errno or errno.EIO, system_message(error), str(path)) from error


def as_text(text: str) -> str:
    """Return text with invalid characters, as of undecodable file names, replaced by U+FFFD."""
    return text.encode(errors="surrogatepass").decode(errors="replace")


def finite(value: Any) -> Any:
    """Return plain data with null for numbers that are not finite, as strict JSON has them."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return value


def write_text(path: str | Path, text: str) -> None:
    """Write text in UTF-8 atomically: see :func:`write_whole`, also for errors."""
    write_whole(path, lambda file: file.write(as_text(text).encode()))


def write_arrays(path: str | Path, arrays: Mapping[str, Any]) -> None:
    """Write a compressed ``.npz`` atomically: see :func:`write_whole`, also for errors.

    It is packed in memory: a ZIP file that cannot be closed, for instance on a full disk, raises
    once more when it is garbage-collected.
    """
    packed = io.BytesIO()
    np.savez_compressed(packed, **arrays)
    write_whole(path, lambda file: file.write(packed.getbuffer()))


def system_message(error: Exception) -> str:
    """Return the system's error message without the file's name."""
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def read_arrays(
    path: str | Path,
    pick: Callable[[list[str]], Collection[str]],
    kinds: Callable[[str], str],
    largest: int,
) -> dict[str, NDArray[Any]]:
    """Return arrays of an NPZ file by name; declared sizes are checked before unpacking.

    ``pick``: selects the wanted arrays from the names of all.
    ``kinds``: returns the allowed kinds of NumPy types (``dtype.kind``) of a name's array.
    ``largest``: of all wanted arrays unpacked [bytes].

    Raises ArrayFileError: missing, damaged, encrypted, too large, an array twice, of another kind,
    or not of the shape that it declares.
    """
    try:
        with zipfile.ZipFile(path) as file:
            entries = [(one.filename.removesuffix(".npy"), one) for one in file.infolist()]
            wanted = pick([name for name, _ in entries])
            entries = [one for one in entries if one[0] in wanted]
            size = sum(entry.file_size for _, entry in entries)
            if size > largest:
                what = f"its arrays have {size} bytes unpacked; at most {largest} can be read"
                raise ArrayFileError(path, what)
            arrays = dict[str, NDArray[Any]]()
            for name, entry in entries:
                if name in arrays:
                    raise ArrayFileError(path, "this array is there twice; remove one", name)
                try:
                    arrays[name] = _array(file, entry, kinds(name))
                except InvalidInputError as error:
                    raise ArrayFileError(path, str(error), name) from error
            return arrays
    except ArrayFileError:
        raise
    except Exception as error:  # damaged files end in errors of zip, zlib, struct, tokenize, ...
        raise ArrayFileError(path, f"cannot be read: {system_message(error)[:200]}") from error


def _array(file: zipfile.ZipFile, entry: zipfile.ZipInfo, kinds: str) -> NDArray[Any]:
    """Return one array, if its header tells what the file holds."""
    if entry.flag_bits & _ENCRYPTED:
        raise InvalidInputError("it is encrypted; save it without a password")
    if entry.compress_type not in _COMPRESSIONS:
        raise InvalidInputError("unknown compression; save it with numpy.savez")
    data = file.read(entry)  # no more than what it declares
    content = io.BytesIO(data)
    version = npy.read_magic(content)
    if version not in _HEADERS:
        raise InvalidInputError(f"unknown version {version} of its header")
    shape, _, dtype = _HEADERS[version](content)
    if dtype.kind not in kinds:
        raise InvalidInputError(
            "it does not hold real numbers" if "f" in kinds else "it does not hold text"
        )
    size = math.prod(shape) * dtype.itemsize  # of any size: an integer of NumPy would overflow
    if min(shape, default=0) < 0 or size != len(data) - content.tell():
        raise InvalidInputError(f"its header says shape {shape}, not what the file holds"[:200])
    content.seek(0)
    return np.asarray(npy.read_array(content, allow_pickle=False))
