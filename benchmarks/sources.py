"""The version of the code that figures depend on."""

import hashlib
from functools import cache
from pathlib import Path

import wbc

SUFFIXES = {".py", ".c", ".h", ".urdf"}


@cache
def code_of(package: Path = Path(wbc.__file__).parent) -> str:
    """Return a hash of a package's sources; results of other code are not continued."""
    content = hashlib.sha256()
    for file in sorted(file for file in package.rglob("*") if file.suffix in SUFFIXES):
        name = file.relative_to(package).as_posix()
        content.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return content.hexdigest()[:16]
