"""A simulation in which hands lean on walls: a supervisor, and hands that are looked after."""

from __future__ import annotations

from collections.abc import Sequence

from wbc.controllers import Controller
from wbc.gait.hand_support import HandSupport
from wbc.robot import Snapshot
from wbc.run.phase_support import PhaseSupport
from wbc.run.supervisor import Supervisor
from wbc.tasks import Task


class WithHands:
    """Leads a simulation as another supervisor does, and hands besides.

    Parameters
    ----------
    first:
        Leads the rest; its controller is that of the hands from beginning to end.
    hands:
        Look for walls before each tick.
    """

    def __init__(self, first: Supervisor, hands: HandSupport) -> None:
        self.first, self.hands = first, hands
        self.controller: Controller = hands.controller

    @property
    def standing(self) -> PhaseSupport:
        """What is held and kept; a hand on a wall is not for long."""
        return self.first.standing

    @property
    def complaint(self) -> str | None:
        """Why the run could not go on, else None."""
        return self.first.complaint

    @property
    def notes(self) -> Sequence[str]:
        """What else is worth saying in the end: what hands did, too."""
        return (*self.first.notes, *self.hands.notes)

    @property
    def tasks(self) -> Sequence[Task]:
        """All tasks whose errors are recorded: not those of hands, which are off mostly."""
        return self.first.tasks

    def update(self, tick: int, snapshot: Snapshot) -> Controller | None:
        """Make everything ready for a tick and return its controller; None to end."""
        found = self.first.update(tick, snapshot)
        if found is not None:
            self.hands.time = tick * self.hands.controller.dt
            self.hands.prepare(snapshot)
        return found

    def move_to(self, time: float) -> None:
        """Set everything that moves to its value at ``time`` [s]."""
        self.first.move_to(time)
