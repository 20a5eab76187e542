"""Ticks of a problem's run in Python, and the controller that made them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from wbc.codegen.known import CodegenError, known
from wbc.codegen.targets import targets_of, task_parts
from wbc.controllers import Controller
from wbc.controllers.closed_loop import LoopTick
from wbc.controllers.native_plan import NativePlan
from wbc.controllers.torque_tick import TorqueTick
from wbc.problem import Problem
from wbc.problem.controller_spec import QpSpec, TorqueSpec
from wbc.problem.walk_spec import WalkSpec
from wbc.qp.daqp import Daqp
from wbc.robot import Snapshot
from wbc.validate import Array

# Why the core hands a tick over: enum handed_over of wbc/native/source/core.h.
_REASONS = {
    -1: "its QP has no solution that is accurate enough",
    1: "a joint is outside its limits",
    2: "a rotation is off by nearly half a turn",
    3: "a number is not finite",
}


class RecordedTick(NamedTuple):
    """One tick: (q, v), all targets of all tasks, velocity and torques (none) commanded."""

    q: Array
    v: Array
    targets: tuple[Array, ...]
    velocity: Array
    torque: Array | None


class Recording:
    """The first ticks of a run; the plan is as it was in the first.

    Attributes
    ----------
    numbers:
        What the core read of the tasks in the first tick.
    ticks:
        Without those of lost frames.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self.controller: Controller
        self.plan: NativePlan
        self.solver: Daqp
        self.numbers: Array
        self.ticks: list[RecordedTick] = []
        self._last: Snapshot | None = None

    def _check(self, now: LoopTick) -> None:
        """Refuse a tick that the core hands over."""
        found, seen = self.plan.problem(now.snapshot), now.snapshot
        if found is not None and found.solved:
            return
        said, _ = self.plan.memory.call(seen.q, seen.v, seen.moving, None)
        raise CodegenError(
            f"the tick at {now.time:g} s ({len(self.ticks)} before it) is one that the exported C"
            f" gives no command in: {_REASONS.get(said, _REASONS[-1])}; record fewer, or start"
            " elsewhere"
        )

    def full(self) -> bool:
        """Whether there are as many ticks as were asked for."""
        return len(self.ticks) >= self._most

    def add(self, now: LoopTick, controller: Controller | None) -> None:
        """Keep a tick.

        Raises
        ------
        CodegenError
            The core alone could not have made it.
        """
        if controller is None or self.full() or now.snapshot is self._last:
            return
        if not self.ticks:
            self.controller = controller
            self.plan, self.solver = known(controller)
        self._check(now)
        if not self.ticks:
            self.numbers = self.plan.memory.number.copy()
        self._last = now.snapshot
        told = (targets_of(part) for part in task_parts(controller))
        targets = tuple(values for one in told if one is not None for values in one)
        torque = now.tick.torque if isinstance(now.tick, TorqueTick) else None
        state = now.snapshot.q, now.snapshot.v
        self.ticks.append(RecordedTick(*state, targets, now.tick.velocity, torque))


def record(problem: Problem, ticks: int) -> Recording:
    """Run a problem of a kind that was checked, of the torque level in simulation.

    Return its first ticks.

    Raises
    ------
    CodegenError
        It is made of something that the core does not know.
    """
    found = Recording(ticks)
    torque = isinstance(problem.spec.controller, TorqueSpec)
    run: Mapping[str, Any] = {"cancelled": found.full, "show": found.add}
    (problem.simulate if torque else problem.run)(**run)
    return found


def check_kind(problem: Problem) -> None:
    """Refuse problems that no single controller solves.

    Raises
    ------
    CodegenError
        A walk, phases, a search, or the pseudo-inverse.
    """
    spec = problem.spec
    reason = None
    if isinstance(spec, WalkSpec):
        reason = "gait: footsteps are planned in Python"
    elif spec.phases is not None:
        reason = "phases: they change the controller while it runs; export one for each"
    elif not isinstance(spec.controller, QpSpec | TorqueSpec):
        reason = "controller.method: only one QP per tick is written out"
    if reason is not None:
        raise CodegenError(f"{problem.source.name}: {reason}")
