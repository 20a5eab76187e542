"""The parts of a problem: robot, tasks, contacts, phases, limits, constraints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.constraints import Contact, Limits
from wbc.controllers import Controller
from wbc.problem.constraint_spec import Surroundings
from wbc.problem.controller_spec import ControllerSpec
from wbc.robot import Robot, Snapshot
from wbc.run.phases import Phase
from wbc.run.ramps import TargetedTask
from wbc.tasks import Task
from wbc.tracking.reference import PlanReference
from wbc.validate import Array

if TYPE_CHECKING:  # motions load SciPy
    from wbc.retargeting.reference import MotionReference


@dataclass(frozen=True, eq=False)
class Parts:
    """The parts of a problem, at its start."""

    robot: Robot
    start: Array  # configuration (nq,)
    targeted: tuple[TargetedTask, ...]  # the tasks, and how their targets are moved
    contacts: tuple[Contact, ...]  # what is held in the first phase
    phases: tuple[Phase, ...]  # what happens, in order; a run without phases is one
    limits: Limits | None
    surroundings: Surroundings
    contact_slack: Mapping[str, float]  # weights of the contacts that may give way, by frame
    plan: PlanReference | MotionReference | None  # what tasks follow, or None

    @property
    def at_start(self) -> Snapshot:
        """The robot at its start, at rest."""
        return self.robot.snapshot(self.start, np.zeros(self.robot.nv))

    @property
    def tasks(self) -> tuple[Task, ...]:
        """All tasks, in the order of the file."""
        return tuple(one.task for one in self.targeted)

    def controller(
        self,
        spec: ControllerSpec,
        tasks: Sequence[Task],
        contacts: Sequence[Contact],
        snapshot: Snapshot,
    ) -> Controller:
        """Return a new controller, without state of earlier runs.

        CoM supports are made of the contacts at ``snapshot``.
        """
        kept = self.constraints_and_slack(contacts, snapshot)
        return spec.build(self.robot, tasks, contacts=contacts, limits=self.limits, **kept)

    def change(
        self,
        controller: Controller,
        tasks: Sequence[Task],
        contacts: Sequence[Contact],
        snapshot: Snapshot,
    ) -> None:
        """Set a controller's tasks and contacts, and the constraints that belong to them."""
        controller.change(
            tasks=tasks, contacts=contacts, **self.constraints_and_slack(contacts, snapshot)
        )

    def constraints_and_slack(
        self, contacts: Sequence[Contact], snapshot: Snapshot
    ) -> dict[str, Any]:
        """Return constraints and slack weights of a controller, by parameter."""
        constraints = self.surroundings.constraints_at(snapshot, contacts)
        here = {one.frame for one in contacts} | {one.name for one in constraints}
        slack = {**self.contact_slack, **self.surroundings.slack}
        return {
            "constraints": constraints,
            "slack": {name: weight for name, weight in slack.items() if name in here},
        }
