"""Joints by name or by shell-style pattern such as ``left_*``."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from wbc.errors import UnknownNameError


def matches(pattern: str, names: Sequence[str]) -> tuple[int, ...]:
    """Return the entries of ``names`` that a name or pattern matches; empty if none does."""
    return tuple(k for k, name in enumerate(names) if fnmatchcase(name, pattern))


def matching(pattern: str, names: Sequence[str], kind: str = "joint") -> tuple[int, ...]:
    """Return the entries of ``names`` that a name or pattern matches.

    Raises
    ------
    UnknownNameError
        None does; ``kind`` says what the name should have been.
    """
    found = matches(pattern, names)
    if not found:
        raise UnknownNameError(kind, pattern, names)
    return found
