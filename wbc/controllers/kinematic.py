"""The velocity level: inverse kinematics by one QP per tick; the unknown is the velocity."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from wbc.constraints.rows import Bounds
from wbc.controllers.closing import LoopClosing
from wbc.controllers.controller import Controller
from wbc.controllers.core_tick import CoreTick
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

    def _plan(self, contacts: tuple[Task, ...], curved: frozenset[str] = frozenset()) -> None:
        super()._plan(contacts, curved)
        self._closing = LoopClosing(self.plan.held, self._added, self.dt)

    def _decided(self, snapshot: Snapshot, begun: float, found: CoreTick | None = None) -> Tick:
        """Return the command of every controller, at whose end loops are closed."""
        closing, decided = self._closing, super()._decided
        if self._plain or not closing.bend or closing.busy:  # plain ticks are closed by the core
            return decided(snapshot, begun, found)
        over = partial(self._is_over, begun)
        with closing.lock:
            tick = decided(snapshot, begun, found)
            if not tick.ok:
                return tick
            return closing.closed(snapshot, tick, self._step, self._core.memory, over)

    def _command(self, snapshot: Snapshot, found: CoreTick) -> Tick:
        return Tick.reading(found, found.velocity, self._errors(found, snapshot))

    def _answer(self, snapshot: Snapshot, outcome: Outcome, rows: Sequence[Bounds]) -> Tick:
        found = outcome.found
        if outcome.solved:
            if outcome.step_scale == 1.0:
                return self._command(snapshot, found)
            velocity = outcome.step_scale * found.velocity
            velocity.setflags(write=False)
            return Tick.reading(found, velocity, self._known(outcome, snapshot))
        closing = self._closing
        if closing.parts and not closing.busy:  # a gear or loop that is off may be the reason
            within = closing.within_reach(snapshot, outcome.box, self._step)
            if within is not None:
                tick, late = within
                tick.__dict__["late"] = tuple(late)
                return tick
        known = self._failed(outcome, snapshot)
        tick = Tick.reading(found, known["velocity"], known)
        if tick.policy == "raise" and not closing.busy:
            raise ControllerFailure(tick.report(), tick)
        return tick

    def _fallback(self, snapshot: Snapshot, outcome: Outcome) -> tuple[Array, dict[str, float]]:
        nv, found = self.robot.nv, outcome.found
        if self.on_failure == "closest":
            qp = found.qp_of(0)
            most = np.full(qp.g.size, np.inf)
            most[:nv] = LARGEST  # where there are no limits
            lower, upper = np.fmax(qp.lower, -most), np.fmin(qp.upper, most)
            least = least_infeasible(qp._replace(lower=lower, upper=upper))
            return least.x[:nv], dict(least.slack)
        if self.on_failure == "damp":
            return np.clip(0.5 * snapshot.v, *outcome.box), {}
        return np.zeros(nv), {}
