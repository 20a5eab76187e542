"""Supervisors of a run: the controller of each tick, and its contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from wbc.controllers import Controller
from wbc.robot import Snapshot
from wbc.run.phase_support import PhaseSupport
from wbc.tasks import Task

BEFORE_START = -1


class Supervisor(Protocol):
    """Prepares every tick, as :class:`~wbc.run.phases.PhaseExecutor` does."""

    controller: Controller  # the present one

    @property
    def standing(self) -> PhaseSupport:
        """Contacts and margins now."""

    @property
    def complaint(self) -> str | None:
        """Why it ended the run; else None."""

    @property
    def notes(self) -> Sequence[str]:
        """Notes for the end of the run."""

    @property
    def tasks(self) -> Sequence[Task]:
        """All tasks whose errors are recorded."""

    def update(self, tick: int, snapshot: Snapshot) -> Controller | None:
        """Prepare a tick and return its controller; None to end.

        ``tick`` counts from 0; before, :data:`BEFORE_START` may be given any number of times: the
        robot stands where the problem begins.
        """

    def move_to(self, time: float) -> None:
        """Set moving targets and obstacles to their values at ``time`` [s]."""
