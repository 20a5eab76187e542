"""Mistakes that show only when objects are made: unknown names, numbers that do not fit the robot.

They are collected, so that a file is corrected in one go.
"""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import TypeVar

from wbc.errors import ProblemFileError, UnknownNameError, WbcError
from wbc.problem.keys import KeyPath
from wbc.problem.source import Source

T = TypeVar("T")


class Misplaced(ProblemFileError):
    """A mistake in the value at ``below``, counted from the path being looked at."""

    def __init__(self, text: str, *below: str | int) -> None:
        super().__init__(text)
        self.below = below


class Mistakes:
    """Collects what is wrong, with the place in the file it comes from."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._found: list[tuple[KeyPath, str]] = []

    def at(self, *path: str | int) -> Noting:
        """Return a context in which a :class:`WbcError` is noted as a mistake at ``path``."""
        return Noting(self, path)

    def require(self, path: KeyPath, make: Callable[[], T]) -> T:
        """Return what ``make`` makes of the value at ``path``.

        Raises
        ------
        ProblemFileError
            If that was a mistake, or there was any before: without this, nothing can go on.
        """
        try:
            made = make()
        except WbcError as error:
            self.note(path, error)
            raise self._error() from error
        self.raise_any()
        return made

    def raise_any(self) -> None:
        """Raise ProblemFileError, with everything noted, if there was any mistake."""
        if self._found:
            raise self._error()

    def _error(self) -> ProblemFileError:
        return ProblemFileError(self._source.messages(self._found))

    def note(self, path: KeyPath, error: WbcError) -> None:
        """Note a mistake; an unknown name is looked for at and below ``path``."""
        if isinstance(error, Misplaced):
            path = (*path, *error.below)
        elif isinstance(error, UnknownNameError):
            path = self._source.find(error.name, path)
        self._found.append((path, str(error)))


class Noting:
    """See :meth:`Mistakes.at`."""

    def __init__(self, mistakes: Mistakes, path: KeyPath) -> None:
        self._mistakes, self._path = mistakes, path

    def __enter__(self) -> None:
        return None

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        _: TracebackType | None,
    ) -> bool:
        if not isinstance(error, WbcError):
            return False
        self._mistakes.note(self._path, error)
        return True
