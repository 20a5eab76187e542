"""The velocity level: inverse kinematics by one QP per tick; the unknown is the velocity."""

from __future__ import annotations

from wbc.controllers.controller import Controller
from wbc.laws import Residual, Rows
from wbc.robot import Snapshot
from wbc.tasks.task import Task


class KinematicController(Controller):
    """Inverse kinematics by one QP per tick; the unknown is the velocity v.

    Tasks are driven by their :class:`~wbc.laws.VelocityLaw`. See
    :class:`~wbc.controllers.controller.Controller` for the parameters.
    """

    def _law(self, task: Task, residual: Residual, snapshot: Snapshot) -> Rows:
        return task.law.rows(residual, task.weight, self.dt)
