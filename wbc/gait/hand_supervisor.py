"""A supervisor that adds hands that lean on walls to another one."""

from __future__ import annotations

from collections.abc import Sequence

from wbc.controllers import Controller
from wbc.gait.hand_support import HandSupport
from wbc.robot import Snapshot
from wbc.run.phase_support import PhaseSupport
from wbc.run.supervisor import BEFORE_START, Supervisor
from wbc.tasks import Task


class WithHands:
    """Supervises a simulation as another supervisor does, and hands as well.

    Parameters
    ----------
    first:
        Supervises the rest; its controller is that of the hands throughout.
    hands:
        Prepared before each tick.
    """

    def __init__(self, first: Supervisor, hands: HandSupport) -> None:
        self.first, self.hands, self._tick = first, hands, BEFORE_START
        self.controller: Controller = hands.controller

    @property
    def standing(self) -> PhaseSupport:
        """Contacts and limits of the first; a hand's contact with a wall is short."""
        return self.first.standing

    @property
    def complaint(self) -> str | None:
        """Why the run could not go on, else None."""
        return self.first.complaint

    @property
    def notes(self) -> Sequence[str]:
        """Those of the first, and what hands did."""
        return (*self.first.notes, *self.hands.notes)

    @property
    def tasks(self) -> Sequence[Task]:
        """All tasks whose errors are recorded, without those of hands, which are mostly off."""
        return self.first.tasks

    def update(self, tick: int, snapshot: Snapshot) -> Controller | None:
        """Prepare a tick and return its controller; None to end.

        Ticks that were skipped since the last call advance hands, too.
        """
        found = self.first.update(tick, snapshot)
        if found is not None:
            self.hands.time = max(tick, 0) * self.hands.controller.dt
            self.hands.prepare(snapshot, max(tick - self._tick, 1))
            self._tick = tick
        return found

    def move_to(self, time: float) -> None:
        """Set everything that moves to its value at ``time`` [s]."""
        self.first.move_to(time)
