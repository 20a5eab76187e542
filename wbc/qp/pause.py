"""When a solver that stalled is asked again."""

from __future__ import annotations

from collections.abc import Hashable
from typing import NamedTuple

# For how many QPs of a name that stalled the solver is left in peace before it is asked once more,
# at first and at most: twice as many after every stall. At 500 Hz 0.2 s, and a minute.
FIRST, LONGEST = 100, 25_600


class _Pause(NamedTuple):
    """For how many QPs more, and of how many."""

    left: int
    length: int


class Pauses(dict[Hashable, _Pause]):
    """For how long a solver is left in peace, by the name of its QPs; mostly there are none."""

    def goes_on(self, name: Hashable) -> bool:
        """Whether the solver is left in peace with this QP; counts."""
        pause = self.get(name)
        if pause is None or pause.left == 0:
            return False
        self[name] = pause._replace(left=pause.left - 1)
        return True

    def begin(self, name: Hashable) -> None:
        """Leave the solver in peace for a while, twice as long as the last time."""
        last = self.get(name)
        length = FIRST if last is None else min(2 * last.length, LONGEST)
        self[name] = _Pause(length, length)
