"""How a loop went."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from wbc.hardware.safety import ASKED, Answer, Event, Fault
from wbc.validate import Array

ANSWERED = (Answer.SOFT_STOP, Answer.STOP)


@dataclass(frozen=True)
class LoopResult:
    """How a loop went.

    Attributes
    ----------
    reason:
        Why it ended.
    ended_at:
        When, by the loop's clock [s].
    good:
        Whether it ended as it was asked to, without a fault that stopped it.
    cycles, missed:
        How many there were, and were left out because one before took too long.
    held:
        Cycles in which the controller was still busy, and its last command was held.
    lateness:
        How late cycles began (cycles,) [s].
    seconds:
        What ticks took, from reading to command (k,) [s].
    events:
        Changes of mode and first faults, in order.
    faults, dropped:
        Cycles with each fault, and messages thrown away by the bus, by reason.
    notes:
        What was not granted, not written, or should be known.
    logs:
        Files of events.
    """

    reason: str
    ended_at: float
    good: bool
    cycles: int
    missed: int
    held: int
    lateness: Array
    seconds: Array
    events: tuple[Event, ...]
    faults: Counter[Fault]
    dropped: Counter[str]
    notes: tuple[str, ...]
    logs: tuple[Path, ...]

    def share_within(self, tolerance: float) -> float:
        """Return the share of all cycles that began within a tolerance [s] of their time.

        Those that were left out did not.
        """
        total = self.cycles + self.missed
        return float((self.lateness <= tolerance).sum()) / total if total else 1.0


def is_fault(event: Event) -> bool:
    """Return whether something stopped the robot that nobody asked for."""
    return event.answer in ANSWERED and not event.what.startswith(ASKED)
