"""Closing loops and gears at the velocity level, where the core alone does not.

Their rows are linearised, so the core integrates each command and takes Newton steps until the
loops are closed there (``native/source/loop_closure.c``). If QPs are modified in Python, the
remaining gap is added to the errors here and the tick is repeated.

A robot may also start with an open gear or loop, as measured after power-up. Closing it in one tick
may be faster than the limits allow; then the largest feasible share of the error is corrected.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

import numpy as np

from wbc.constraints.contact import ContactRows
from wbc.constraints.limits import Box
from wbc.constraints.mechanics import BoltedBase, Mechanics
from wbc.controllers.core_memory import CoreMemory
from wbc.controllers.tick import Tick
from wbc.native import lib
from wbc.robot import Snapshot
from wbc.validate import Array, Floats

OPEN_TOLERANCE = 1e-9  # m, rad: smaller errors cannot be why a QP is infeasible
HALVINGS = 6  # of the interval for the share of errors that is corrected
LEFT_OPEN = "what loops miss to second order"
LIMIT_SHARE = 1.0 - 1e-9  # of the rates that limits allow

Step = Callable[[Snapshot], Tick]


class LoopClosing:
    """Repeats ticks until gears and loops among the contacts are closed at their end.

    ``held``: the contacts that are met exactly.
    ``error_offset``: (held,) added by the core to their errors; written here.

    ``parts``: all gears and loops, and their rows among the held ones.
    ``nonlinear``: whether any of them is nonlinear in q.
    ``busy``: whether a tick is being repeated.
    ``lock``: held meanwhile: threads that share a controller take turns.
    """

    def __init__(self, held: ContactRows, error_offset: Array, dt: float) -> None:
        self._arguments = held, error_offset, dt
        self.parts: list[tuple[Mechanics, slice]] = []
        begin = 0
        for one, kept in zip(held.contacts, held.row_selections, strict=True):
            end = begin + (len(one.rows) if kept is None else len(kept))
            if isinstance(one, Mechanics) and not isinstance(one, BoltedBase):
                self.parts.append((one, slice(begin, end)))
            begin = end
        self.nonlinear = any(one.nonlinear for one, _ in self.parts)
        self._error_offset, self._dt = error_offset, dt
        self.busy, self.lock = False, threading.RLock()

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), self._arguments  # a copy has a lock of its own

    def close(
        self,
        snapshot: Snapshot,
        tick: Tick,
        step: Step,
        memory: CoreMemory,
        is_over: Callable[[], bool],
    ) -> Tick:
        """Return a tick whose command ends with closed loops; ``step`` repeats it.

        Once the deadline ``is_over`` nothing is repeated: the next tick corrects the gap.
        """
        found = tick
        self.busy = True
        try:
            for _ in range(lib.CLOSING_ROUNDS):
                missed = memory.gaps(snapshot, found.velocity)
                worst = float(np.abs(missed).max())
                if worst <= lib.wbc_closed or not worst < lib.wbc_far_open:
                    break
                if is_over():
                    found.__dict__["left_out"] = (*found.left_out, LEFT_OPEN)
                    break
                self._error_offset += missed
                again = step(snapshot)
                if not again.ok:  # redundant rows may become inconsistent
                    break
                found = again
        finally:
            self._reset()
        return found

    def close_within_limits(
        self, snapshot: Snapshot, box: Box, step: Step
    ) -> tuple[Tick, list[str]] | None:
        """Return a tick that corrects as much of the errors as limits allow, and which are late.

        None: open loops are not why the tick has no solution.
        """
        residuals = [one.residual(snapshot) for one, _ in self.parts]
        if not any(float(np.abs(one.error).max()) > OPEN_TOLERANCE for one in residuals):
            return None
        errors = [residual.error for residual in residuals]
        shares = [_reachable_share(one.jacobian, one.error / self._dt, box) for one in residuals]
        self.busy = True
        try:
            if not self._step_with(snapshot, errors, np.zeros(len(shares)), step).ok:
                return None
            feasible, infeasible = 0.0, 1.0
            found = self._step_with(snapshot, errors, LIMIT_SHARE * np.array(shares), step)
            if found.ok:
                late = zip(self.parts, shares, strict=True)
                return found, [one.name for (one, _), share in late if share < 1.0]
            for _ in range(HALVINGS):
                middle = 0.5 * (feasible + infeasible)
                tick = self._step_with(snapshot, errors, middle * np.array(shares), step)
                if tick.ok:
                    feasible, found = middle, tick
                else:
                    infeasible = middle
            if not found.ok:
                found = self._step_with(snapshot, errors, np.zeros(len(shares)), step)
            return found, [one.name for one, _ in self.parts]
        finally:
            self._reset()

    def _step_with(
        self, snapshot: Snapshot, errors: Sequence[Floats], shares: Array, step: Step
    ) -> Tick:
        """Return the tick that corrects these shares of the errors."""
        for (_, where), error, share in zip(self.parts, errors, shares.tolist(), strict=True):
            self._error_offset[where] = (share - 1.0) * error
        return step(snapshot)

    def _reset(self) -> None:
        self.busy = False
        self._error_offset[:] = 0.0


def _reachable_share(J: Array, rate: Floats, box: Box) -> float:
    """Return the share of minus ``rate`` (k,) that every row of J v can reach alone, v in a box."""
    lower, upper = (np.clip(side, -1e9, 1e9) for side in box)
    J = -np.sign(rate)[:, None] * J  # towards 0 error
    reachable, wanted = np.maximum(J * lower, J * upper).sum(axis=1), np.abs(rate)
    shares = np.divide(reachable, wanted, out=np.ones_like(wanted), where=wanted != 0.0)
    return float(np.clip(shares.min(), 0.0, 1.0))
