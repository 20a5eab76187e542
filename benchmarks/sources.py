"""What figures depend on beside their settings: the code that they were measured with."""

import hashlib
from functools import cache
from pathlib import Path

import wbc

SUFFIXES = {".py", ".c", ".h", ".urdf"}


@cache
def code_of(package: Path = Path(wbc.__file__).parent) -> str:
    """Return a hash of a package's sources: what a run found so far, other code does not go on."""
    content = hashlib.sha256()
    for file in sorted(file for file in package.rglob("*") if file.suffix in SUFFIXES):
        name = file.relative_to(package).as_posix()
        content.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return content.hexdigest()[:16]
