"""Declared attributes: assigning an undeclared one, most likely misspelt, is an error."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import get_annotations
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, suggest
from wbc.validate import Array


class ArrayAttribute(Protocol):
    """For type checkers: an attribute that is read as an array and accepts any array-like."""

    def __get__(self, owner: object, kind: type | None = None) -> Array: ...
    def __set__(self, owner: object, value: ArrayLike) -> None: ...


class DeclaredAttributes:
    """Base of objects that accept only attributes which their class declares.

    Declared are annotated and defined names, and private ones (``_``). Subclasses outside this
    package accept any attribute, as in plain Python.
    """

    _declared: ClassVar[frozenset[str]] = frozenset()
    _fixed: ClassVar[Mapping[str, str]] = {}  # not assignable, with what to do instead
    _takes_any: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls._takes_any = not cls.__module__.startswith("wbc.")
        cls._declared = frozenset(dir(cls)).union(*map(get_annotations, cls.__mro__))
        if "_set_attribute" in cls.__dict__:  # no call in between; unseen by checkers, as below
            type.__setattr__(cls, "__setattr__", cls._set_attribute)

    def _set_attribute(self, name: str, value: object) -> None:
        """Assign an attribute; subclasses override this for checks and side effects.

        Raises InvalidInputError: it is not declared, or it is only read when the object is made:
        assigning it would change nothing.
        """
        if name in self._declared:
            if name in self._fixed and name in self.__dict__:
                raise InvalidInputError(f"{self!r}: {name} cannot be assigned; {self._fixed[name]}")
        elif not (self._takes_any or name.startswith("_")):
            names = [key for key in self._declared if not key.startswith("_")]
            hint = suggest(name, names, listed=0)
            raise InvalidInputError(f"{self} has no attribute {name!r}{hint}")
        object.__setattr__(self, name, value)

    # No __getattr__, which would say more of a misspelt name than Python's own hint: a class that
    # has one reads all of its attributes more slowly, by 3 % of a tick.
    if not TYPE_CHECKING:  # a checker that sees this method lets every name be assigned
        __setattr__ = _set_attribute
