"""A mailbox that holds the latest item only: who puts never waits, who takes may miss some."""

from __future__ import annotations

from typing import Generic, TypeVar

Item = TypeVar("Item")


class Mailbox(Generic[Item]):
    """One place for one item; :meth:`put` replaces what nobody has taken.

    For one thread that puts and one that takes. Storing and exchanging a reference are single
    operations of the interpreter, so neither needs a lock.

    Attributes
    ----------
    put_count, taken_count:
        How many items were put and taken; the difference was dropped, or is still here.
    """

    def __init__(self) -> None:
        self.put_count = self.taken_count = 0
        self._places: list[Item] = []

    def put(self, item: Item) -> None:
        """Leave an item, instead of the one before."""
        self._places = [item]
        self.put_count += 1

    def take(self) -> Item | None:
        """Return the latest item, once; None if there is no new one."""
        places = self._places
        try:
            item = places.pop()
        except IndexError:
            return None
        self.taken_count += 1
        return item

    @property
    def dropped(self) -> int:
        """How many items were replaced before anyone took them."""
        return self.put_count - self.taken_count - len(self._places)
