"""Objects without new attributes after construction: to assign a misspelt one is an error."""

from __future__ import annotations

import inspect
from abc import ABCMeta
from collections.abc import Mapping
from typing import Any, ClassVar

from wbc.errors import InvalidInputError, suggest
from wbc.robot.model import check_robot

MARK = "_sealed"  # set on objects that are made


class Sealed(ABCMeta):
    """Marks what it makes as sealed; their ``__setattr__`` calls :func:`check_attribute`."""

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        """Make an object and seal it."""
        try:
            made = super().__call__(*args, **kwargs)
        except AttributeError:  # of what should have been a robot, before Task.__init__ saw it
            if "robot" in kwargs or args:
                check_robot(cls.__name__, kwargs.get("robot", *args[:1]))
            raise
        except TypeError:
            _check_call(cls, args, kwargs)
            raise
        object.__setattr__(made, MARK, True)
        return made


def _check_call(made: type, given: tuple[Any, ...], named: Mapping[str, Any]) -> None:
    """Raise InvalidInputError if the arguments are not those that the constructor takes."""
    signature = inspect.signature(made.__init__)  # type: ignore[misc]  # of the class
    try:
        signature.bind(None, *given, **named)
    except TypeError as error:
        empty = inspect.Parameter.empty
        takes = [one.replace(annotation=empty) for one in signature.parameters.values()][1:]
        shown = signature.replace(parameters=takes, return_annotation=empty)
        pose = any(hasattr(x, "translation") or getattr(x, "shape", 0) == (4, 4) for x in given)
        hint = "; of a pose T give T.translation, T.rotation" if pose else ""
        name = made.__name__
        raise InvalidInputError(f"{name}: {error}; it is {name}{shown}{hint}") from error


def check_attribute(made: object, name: str) -> None:
    """Raise InvalidInputError if an attribute would be a new one of a sealed object."""
    if hasattr(made, MARK) and not hasattr(made, name):
        names = [key for key in dir(made) if not key.startswith("_")]
        raise InvalidInputError(f"{made} has no attribute {name!r}{suggest(name, names, listed=0)}")


class Fixed(metaclass=Sealed):
    """Objects of which some attributes are only read when they are made.

    To assign such a one later would change nothing, nor would a new one, most likely misspelt: both
    are refused. Those that begin with _ are the object's own.
    """

    _fixed: ClassVar[Mapping[str, str]] = {}  # by name: what to do instead

    def __setattr__(self, name: str, value: object) -> None:
        if not name.startswith("_"):
            check_attribute(self, name)
        if name in self._fixed and name in self.__dict__:
            raise InvalidInputError(f"{self!r}: {name} cannot be assigned; {self._fixed[name]}")
        object.__setattr__(self, name, value)
