"""The velocity level: inverse kinematics by one QP per tick; the unknown is the velocity."""

from __future__ import annotations

from typing import Any

from wbc.constraints.collision import SelfCollision
from wbc.controllers.levels import LevelProblem, Outcome
from wbc.controllers.look_ahead import MarginRows
from wbc.controllers.native_plan import NativePlan
from wbc.controllers.native_problem import NativeProblem
from wbc.controllers.native_tick import NativeController
from wbc.controllers.plan import NO_PHYSICS, Physics
from wbc.controllers.tick import Tick
from wbc.laws import Residual, Rows
from wbc.qp.backend import Backend
from wbc.robot import Snapshot
from wbc.tasks.task import Task
from wbc.validate import read_only


class KinematicController(NativeController):
    """Inverse kinematics by one QP per tick; the unknown is the velocity v.

    Tasks are driven by their :class:`~wbc.laws.VelocityLaw`. See
    :class:`~wbc.controllers.controller.Controller` for the parameters.
    """

    def _law(self, task: Task, residual: Residual, snapshot: Snapshot) -> Rows:
        return task.law.rows(residual, task.weight, self.dt)

    def _native_plan(
        self, backend: Backend | None, margin: SelfCollision | None
    ) -> NativePlan | None:
        tasks = self.robot, self.tasks, self.plan
        return NativePlan.of(*tasks, self.limits, self.dt, backend, None, margin)

    def _native_tick(self, found: NativeProblem, snapshot: Snapshot, known: dict[str, Any]) -> Tick:
        return Tick.reading(found, velocity=read_only(found.velocity), **known)

    def _native_physics(self, found: NativeProblem, snapshot: Snapshot) -> Physics:
        return NO_PHYSICS

    def _attempt(self, problem: LevelProblem, margins: MarginRows | None) -> tuple[Outcome, float]:
        return self._solve(problem, margins)
