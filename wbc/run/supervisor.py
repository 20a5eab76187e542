"""Supervisors of a simulation: which controller is in charge of each tick, and what it holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from wbc.controllers import Controller
from wbc.robot import Snapshot
from wbc.run.phase_support import PhaseSupport
from wbc.tasks import Task


class Supervisor(Protocol):
    """Hands over from tick to tick, as :class:`~wbc.run.phases.PhaseExecutor` does."""

    controller: Controller  # in charge now

    @property
    def standing(self) -> PhaseSupport:
        """What it holds and keeps."""

    @property
    def complaint(self) -> str | None:
        """Why it could not go on, which ended the run; else None."""

    @property
    def notes(self) -> Sequence[str]:
        """What else is worth saying in the end."""

    @property
    def tasks(self) -> Sequence[Task]:
        """All tasks whose errors are recorded."""

    def update(self, tick: int, snapshot: Snapshot) -> Controller | None:
        """Make everything ready for a tick and return its controller; None to end."""

    def move_to(self, time: float) -> None:
        """Set everything that moves to its value at ``time`` [s]."""
