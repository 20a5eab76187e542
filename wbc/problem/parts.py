"""What a problem is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from wbc.constraints import Contact, Limits
from wbc.controllers import KinematicController
from wbc.problem.build_constraints import Surroundings
from wbc.problem.controller_specs import PseudoInverseSpec, QpSettings
from wbc.qp.backend import Backend, make_backend
from wbc.robot import Robot, Snapshot
from wbc.run.phases import Phase
from wbc.run.ramps import TargetedTask
from wbc.tasks import Task
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Parts:
    """What a problem is made of, at its start.

    Attributes
    ----------
    start:
        Configuration (nq,).
    targeted:
        The tasks, and how their targets are moved.
    contacts:
        What is held in the first phase.
    phases:
        What happens, in order; a run without phases is one.
    """

    robot: Robot
    start: Array
    targeted: tuple[TargetedTask, ...]
    contacts: tuple[Contact, ...]
    phases: tuple[Phase, ...]
    limits: Limits | None
    surroundings: Surroundings
    contact_slack: Mapping[str, float]

    @property
    def tasks(self) -> tuple[Task, ...]:
        """All tasks, in the order of the file."""
        return tuple(one.task for one in self.targeted)

    def controller(
        self,
        spec: QpSettings | PseudoInverseSpec,
        tasks: Sequence[Task],
        contacts: Sequence[Contact],
        snapshot: Snapshot,
    ) -> KinematicController:
        """Return a new controller, which remembers nothing of earlier runs.

        CoM supports are those of the contacts as they are at ``snapshot``.
        """
        constraints = self.surroundings.around(snapshot, contacts)
        frames = [contact.frame for contact in contacts]
        slack = {frame: w for frame, w in self.contact_slack.items() if frame in frames}
        slack |= self.surroundings.slack_of(constraints)
        common: dict[str, Any] = {
            "contacts": contacts,
            "constraints": constraints,
            "slack": slack,
            "limits": self.limits,
            "dt": spec.dt,
            "damping": spec.damping,
            "joint_weights": spec.joint_weights,
        }
        if isinstance(spec, PseudoInverseSpec):
            return KinematicController(self.robot, tasks, solver="pseudo_inverse", **common)
        return KinematicController(
            self.robot,
            tasks,
            solver=backend_of(spec),
            formulation=spec.formulation,
            on_failure=spec.on_failure,
            **common,
        )


def backend_of(spec: QpSettings) -> Backend:
    """Return the QP solver that a problem asks for."""
    settings = {} if spec.eps is None else {"eps": spec.eps}
    return make_backend(spec.solver, **settings)
