"""Ticks of a problem's run in Python, and the controller that made them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

from wbc.codegen.core_parts import CodegenError, core_parts
from wbc.codegen.targets import targets_of, task_parts
from wbc.controllers import Controller
from wbc.controllers.closed_loop import LoopTick
from wbc.controllers.core_plan import CorePlan
from wbc.controllers.torque_tick import TorqueTick
from wbc.native import lib
from wbc.problem import Problem
from wbc.problem.controller_spec import QpSpec, TorqueSpec
from wbc.problem.walk import WalkSpec
from wbc.qp.active_set import ActiveSet
from wbc.robot import Snapshot
from wbc.validate import Array

# Why the core gives no command: enum status of wbc/native/source/core.h.
_REASONS = {
    lib.INFEASIBLE: "its QP has no solution: rows contradict each other",
    lib.UNSOLVED: "its QP has no solution that is accurate enough",
    lib.NOT_FINITE: "a number is not finite",
    lib.NOT_MEASURED: "a distance of two bodies could not be measured",
    lib.LEADS_INSIDE: "it leads two bodies inside their margin, which takes one more QP",
    lib.MORE_ROWS: "more pairs of bodies could not stop in time than get a row",
}


class RecordedTick(NamedTuple):
    """One tick: (q, v), all targets of all tasks, velocity and torques (none) commanded."""

    q: Array
    v: Array
    targets: tuple[Array, ...]
    velocity: Array
    torque: Array | None


class TickRecording:
    """The first ticks of a run.

    ``numbers``: what the core read of the tasks in the first tick.
    ``ticks``: without those of lost frames, and those left out.
    ``left_out``: ticks in which the core alone gives no command, by the reason.
    ``fell``: why and when the simulated robot fell; empty if it stood.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self.controller: Controller
        self.plan: CorePlan
        self.solver: ActiveSet
        self.numbers: Array
        self.ticks: list[RecordedTick] = []
        self.left_out = Counter[str]()
        self.fell = ""
        self._last: Snapshot | None = None

    def full(self) -> bool:
        """Whether the requested number of ticks was seen."""
        return len(self.ticks) + self.left_out.total() >= self._most

    def add(self, now: LoopTick, controller: Controller | None) -> None:
        """Keep a tick.

        Raises CodegenError: the controller has something that the core does not know.
        """
        seen = now.snapshot
        if controller is None or self.full() or seen is self._last:
            return
        if self._last is None:
            self.controller = controller
            self.plan, self.solver = core_parts(controller)
        self._last = seen
        found = self.plan.tick(seen)
        if found is None or not found.is_whole:
            self.left_out[_REASONS.get(self.plan.memory.status, _REASONS[lib.UNSOLVED])] += 1
            return
        if not self.ticks:
            self.numbers = self.plan.memory.arrays["number"].copy()
        told = (targets_of(part) for part in task_parts(controller))
        targets = tuple(values for one in told if one is not None for values in one)
        torque = now.tick.torque if isinstance(now.tick, TorqueTick) else None
        self.ticks.append(RecordedTick(seen.q, seen.v, targets, now.tick.velocity, torque))


def record(problem: Problem, ticks: int) -> TickRecording:
    """Run a problem of a kind that was checked, of the torque level in simulation.

    Return its first ticks.
    """
    found = TickRecording(ticks)
    torque = isinstance(problem.spec.controller, TorqueSpec)
    run: Mapping[str, Any] = {"cancelled": found.full, "show": found.add}
    if torque:
        verdict = problem.simulate(**run).verdict
        found.fell = "" if verdict.stood else verdict.reason
    else:
        problem.run(**run)
    if not found.ticks:
        reasons = ", ".join(found.left_out)
        raise CodegenError(f"the exported C gives no command in any tick of the run: {reasons}")
    return found


def check_kind(problem: Problem) -> None:
    """Refuse problems that no single controller solves.

    Raises CodegenError: a walk, phases, hands that lean, a law with two gains, a search, the
    pseudo-inverse, or wrenches that the controller is told of.
    """
    spec = problem.spec
    reason = None
    if isinstance(spec, WalkSpec):
        reason = "gait: footsteps are planned in Python"
    elif spec.phases is not None:
        reason = "phases: they change the controller while it runs"
    elif spec.hands is not None:
        reason = "hands: they change its contacts while it runs"
    elif attended := [one.task.name for one in problem.parts.targeted if one.attendant]:
        reason = f"tasks.{attended[0]}.law.spin: the gain is chosen in Python, tick by tick"
    elif not isinstance(spec.controller, QpSpec | TorqueSpec):
        reason = "controller.method: only one QP per tick is written out"
    elif any(wrench.told for wrench in spec.simulation.wrenches):
        reason = "simulation.wrenches: the code is told of none; told: false leaves them out of it"
    if reason is not None:
        raise CodegenError(f"{problem.source.name}: {reason}")
