"""Checks on arguments that are not numbers: objects, words, switches.

Whatever is no such thing (an array where a word is expected, the path of a robot in place of the
robot) is an error that says what was meant, before anything is compared with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from os.path import exists
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError, UnknownNameError, shown
from wbc.validate import finite_number, set_fields


def check_kind(
    what: str, value: object, kind: type, how: str = "", *, or_none: bool = False
) -> None:
    """Raise InvalidInputError unless a value is of a type; ``how`` shows one in Python."""
    if not (isinstance(value, kind) or (or_none and value is None)):
        wanted = f"a {kind.__name__}" + (f", such as {how}" if how else "")
        wanted += " or None" if or_none else ""
        raise InvalidInputError(f"{what}: expected {wanted}, got {shown(value)}")


def check_callable(what: str, value: object, arguments: str) -> None:
    """Raise InvalidInputError unless a value is callable with some arguments, or None."""
    if value is not None and not callable(value):
        raise InvalidInputError(
            f"{what}: expected a function of {arguments} or None, got {shown(value)}"
        )


def switch(what: str, value: Any) -> bool:
    """Return True or False; InvalidInputError for other values, such as ``"no"``."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidInputError(f"{what}: expected True or False, got {shown(value)}")
    return bool(value)


def check_switches(instance: Any, what: str, *names: str) -> None:
    """Make fields of a dataclass, frozen or not, the :func:`switch` that each is."""
    set_fields(
        instance, **{name: switch(f"{what}{name}", getattr(instance, name)) for name in names}
    )


def whole_number(what: str, value: Any, *, least: int = 0, most: float = 1e6) -> int:
    """Return a count, from ``least`` to ``most``; 3.0 is 3."""
    number = finite_number(what, value, least=least)
    if not number.is_integer():
        raise InvalidInputError(f"{what}: expected a whole number, got {shown(value)}")
    if number > most:
        raise InvalidInputError(f"{what}: must be at most {most:g}, got {shown(value)}")
    return int(value)


def check_word(what: str, value: object, *, empty: bool = False) -> None:
    """Raise InvalidInputError unless a value is a text; ``empty`` allows an empty one."""
    if not isinstance(value, str) or not (value or empty):
        raise InvalidInputError(f"{what}: expected a name, got {shown(value)}")


def check_path(what: str, value: object) -> None:
    """Raise InvalidInputError unless a value is the path of a file or folder."""
    if not isinstance(value, str | PathLike):
        raise InvalidInputError(f"{what}: expected a path, got {shown(value)}")
    if isinstance(value, str) and "\n" in value and not exists(value):
        raise InvalidInputError(
            f"{what}: expected a path, got text of several lines: {shown(value)}"
        )


def one_of(kind: str, value: Any, choices: Sequence[str]) -> str:
    """Return ``value`` if it is one of the choices; otherwise raise UnknownNameError."""
    if not isinstance(value, str) or value not in choices:
        raise UnknownNameError(kind, value, choices)
    return value
