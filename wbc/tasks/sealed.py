"""Objects whose attributes are those they have when they are made: a misspelt one is an error."""

from __future__ import annotations

from abc import ABCMeta
from typing import Any

from wbc.errors import InvalidInputError, suggest
from wbc.robot.model import check_robot

MARK = "_sealed"  # set on objects that are made


class Sealed(ABCMeta):
    """Seals what it makes; who derives from it asks :func:`check_attribute` when one is set."""

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        """Make an object and seal it."""
        try:
            made = super().__call__(*args, **kwargs)
        except AttributeError:  # of what should have been a robot, before Task.__init__ saw it
            if "robot" in kwargs or args:
                check_robot(cls.__name__, kwargs.get("robot", args[0] if args else None))
            raise
        object.__setattr__(made, MARK, True)
        return made


def check_attribute(made: object, name: str) -> None:
    """Raise InvalidInputError if an attribute would be a new one of a sealed object."""
    if hasattr(made, MARK) and not hasattr(made, name):
        names = [key for key in dir(made) if not key.startswith("_")]
        raise InvalidInputError(f"{made} has no attribute {name!r}{suggest(name, names, listed=0)}")
