"""Who gives a QP to a solver and judges the answer itself."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class Judge(Protocol):
    """Who gave a QP away, and takes its answers back: the native core."""

    @property
    def iterations(self) -> int:
        """Of the last answer."""
        ...

    def takes(self, x: bytes, z: bytes, scale: float, iterations: int) -> bool:
        """Whether x (n,), and z (mi + n,) of rows, then of bounds, times ``scale``, will do."""
        ...

    def solves(self) -> bool:
        """Whether it finds an answer itself, by the active-set method."""
        ...


class Answered(NamedTuple):
    """Who answered, and how many were asked."""

    solver: str
    attempts: int
