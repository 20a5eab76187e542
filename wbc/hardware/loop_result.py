"""The result of a loop."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from wbc.hardware.safety import REQUESTED, Answer, Event, Fault
from wbc.validate import Array

STOPPING = (Answer.SOFT_STOP, Answer.STOP)
HANGS = "it hangs: its feet bear "


@dataclass(frozen=True)
class LoopResult:
    """The result of a loop.

    Attributes
    ----------
    reason:
        Why it ended.
    ended_at:
        By the loop's clock [s].
    good:
        Whether it ended on request, and no fault stopped the robot.
    cycles, missed:
        Number of cycles, and of those skipped because one before took too long.
    held:
        Number of cycles in which the controller was busy, and its last command was held.
    lateness:
        Of the cycles' beginnings (cycles,) [s].
    seconds:
        Durations of ticks, from reading to command (k,) [s].
    events:
        Changes of mode and first faults, in order.
    faults, dropped:
        Number of cycles with each fault, and of messages dropped by the bus, by reason.
    notes:
        What was not granted or not written, and other notes.
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

    @property
    def hung(self) -> bool:
        """Whether it went down because its feet bore too little of the weight."""
        return any(event.what.startswith(HANGS) for event in self.events)

    def share_within(self, tolerance: float) -> float:
        """Return the share of all cycles, skipped ones too, that began within a tolerance [s]."""
        total = self.cycles + self.missed
        return float((self.lateness <= tolerance).sum()) / total if total else 1.0


def is_fault(event: Event) -> bool:
    """Return whether an event is a stop that nobody requested."""
    return event.answer in STOPPING and not event.what.startswith((REQUESTED, HANGS))
