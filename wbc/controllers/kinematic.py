"""The velocity level: inverse kinematics by one QP per tick; the unknown is the velocity."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from wbc.constraints.rows import Bounds
from wbc.controllers.controller import Controller
from wbc.controllers.core_tick import CoreTick
from wbc.controllers.loop_closing import LoopClosing
from wbc.controllers.outcome import Outcome
from wbc.controllers.tick import Tick
from wbc.errors import ControllerFailure
from wbc.qp.least_infeasible import least_infeasible
from wbc.robot import Snapshot
from wbc.robot.tree import LARGEST
from wbc.tasks.task import Task
from wbc.validate import Array


class KinematicController(Controller):
    """Inverse kinematics by one QP per tick; the unknown is the velocity v.

    Tasks are driven by their :class:`~wbc.laws.VelocityLaw`. See
    :class:`~wbc.controllers.controller.Controller` for the parameters.
    """

    _closing: LoopClosing

    _planned = (*Controller._planned, "_closing")

    def _make_plan(self, contacts: tuple[Task, ...], curved: frozenset[str]) -> None:
        super()._make_plan(contacts, curved)
        self._closing = LoopClosing(self.plan.held, self._error_offset, self.dt)

    def _step_in_python(
        self, snapshot: Snapshot, start_time: float, core_tick: CoreTick | None = None
    ) -> Tick:
        """Return the tick's command, with loops closed at its end."""
        closing, decided = self._closing, super()._step_in_python
        if self._core_suffices or not closing.nonlinear or closing.busy:  # the core closes them
            return decided(snapshot, start_time, core_tick)
        over = partial(self._deadline_over, start_time)
        with closing.lock:
            tick = decided(snapshot, start_time, core_tick)
            if not tick.ok:
                return tick
            return closing.close(snapshot, tick, self._step, self._core.memory, over)

    def _command(self, snapshot: Snapshot, core_tick: CoreTick) -> Tick:
        return Tick.reading(core_tick, core_tick.velocity, self._errors(core_tick, snapshot))

    def _answer(self, snapshot: Snapshot, outcome: Outcome, rows: Sequence[Bounds]) -> Tick:
        core_tick = outcome.core_tick
        if outcome.solved:
            if outcome.step_scale == 1.0:
                return self._command(snapshot, core_tick)
            velocity = outcome.step_scale * core_tick.velocity
            velocity.setflags(write=False)
            return Tick.reading(core_tick, velocity, self._extra_fields(outcome, snapshot))
        closing = self._closing
        if closing.parts and not closing.busy:  # an open gear or loop may be the reason
            within = closing.close_within_limits(snapshot, outcome.box, self._step)
            if within is not None:
                tick, late = within
                tick.__dict__["late"] = tuple(late)
                return tick
        known = self._fallback_fields(outcome, snapshot)
        tick = Tick.reading(core_tick, known["velocity"], known)
        if tick.policy == "raise" and not closing.busy:
            raise ControllerFailure(tick.report(), tick)
        return tick

    def _fallback(self, snapshot: Snapshot, outcome: Outcome) -> tuple[Array, dict[str, float]]:
        nv, core_tick = self.robot.nv, outcome.core_tick
        if self.on_failure == "closest":
            qp = core_tick.qp_of(0)
            most = np.full(qp.g.size, np.inf)
            most[:nv] = LARGEST  # where there are no limits
            lower, upper = np.fmax(qp.lower, -most), np.fmin(qp.upper, most)
            least = least_infeasible(qp._replace(lower=lower, upper=upper))
            return least.x[:nv], dict(least.slack)
        if self.on_failure == "damp":
            return np.clip(0.5 * snapshot.v, *outcome.box), {}
        return np.zeros(nv), {}
