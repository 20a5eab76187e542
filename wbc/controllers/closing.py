"""Gears and loops of the velocity level that are off, and those that the core alone does not close.

Their rows are linear, and mechanisms bend: the core looks where a command leads, and takes Newton
steps until the loops are closed there (``native/source/closing.c``). Where QPs are changed in
Python on their way to a command, what is left open is added to the errors here, and the tick is
done again.

And a robot may begin with a gear or loop that is off, as measured after power-up. All of that in
one tick may be faster than the limits allow; then as much of it is taken back as they do.
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
from wbc.validate import Array

OFF = 1e-9  # m, rad: smaller errors are no reason why a tick cannot be had
HALVINGS = 6  # of the part of errors that is taken back
REST = "what loops miss to second order"
INSIDE = 1.0 - 1e-9  # of what limits allow

Step = Callable[[Snapshot], Tick]


class LoopClosing:
    """What the velocity level does for the gears and loops among its contacts.

    Parameters
    ----------
    held:
        The contacts that are met exactly.
    added:
        (held,) what the core adds to their errors: written here.

    Attributes
    ----------
    parts:
        All gears and loops, and their rows among those that are held.
    bend:
        Whether rows of any are linear in the command to first order only.
    busy:
        Whether a tick is being done again.
    lock:
        Held while one is: threads that share a controller take turns.
    """

    def __init__(self, held: ContactRows, added: Array, dt: float) -> None:
        self._made_of = held, added, dt
        self.parts: list[tuple[Mechanics, slice]] = []
        begin = 0
        for one, kept in zip(held.contacts, held.kept, strict=True):
            end = begin + (len(one.rows) if kept is None else len(kept))
            if isinstance(one, Mechanics) and not isinstance(one, BoltedBase):
                self.parts.append((one, slice(begin, end)))
            begin = end
        self.bend = any(one.bends for one, _ in self.parts)
        self._added, self._dt, self.busy, self.lock = added, dt, False, threading.RLock()

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), self._made_of  # a copy has a lock of its own

    def closed(
        self,
        snapshot: Snapshot,
        tick: Tick,
        step: Step,
        memory: CoreMemory,
        is_over: Callable[[], bool],
    ) -> Tick:
        """Return the tick whose command ends with closed loops; ``step`` does it again.

        Not once the deadline ``is_over``: what is open then is taken back in the next tick.
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
                    found.__dict__["left_out"] = (*found.left_out, REST)
                    break
                self._added += missed
                again = step(snapshot)
                if not again.ok:  # rows that follow from others may contradict each other
                    break
                found = again
        finally:
            self._forget()
        return found

    def within_reach(
        self, snapshot: Snapshot, box: Box, step: Step
    ) -> tuple[Tick, list[str]] | None:
        """Return a tick that takes back as much of the errors as limits allow, and whose.

        None: that is not why the tick cannot be had.
        """
        residuals = [one.residual(snapshot) for one, _ in self.parts]
        if not any(float(np.abs(one.error).max()) > OFF for one in residuals):
            return None
        errors = [residual.error for residual in residuals]
        parts = [_part(one.jacobian, one.error / self._dt, box) for one in residuals]
        self.busy = True
        try:
            if not self._tried(snapshot, errors, np.zeros(len(parts)), step).ok:
                return None
            least, most = 0.0, 1.0
            found = self._tried(snapshot, errors, INSIDE * np.array(parts), step)
            if found.ok:
                late = zip(self.parts, parts, strict=True)
                return found, [one.name for (one, _), part in late if part < 1.0]
            for _ in range(HALVINGS):
                middle = 0.5 * (least + most)
                tried = self._tried(snapshot, errors, middle * np.array(parts), step)
                if tried.ok:
                    least, found = middle, tried
                else:
                    most = middle
            if not found.ok:
                found = self._tried(snapshot, errors, np.zeros(len(parts)), step)
            return found, [one.name for one, _ in self.parts]
        finally:
            self._forget()

    def _tried(self, snapshot: Snapshot, errors: Sequence[Array], parts: Array, step: Step) -> Tick:
        for (_, where), error, part in zip(self.parts, errors, parts.tolist(), strict=True):
            self._added[where] = (part - 1.0) * error
        return step(snapshot)

    def _forget(self) -> None:
        self.busy = False
        self._added[:] = 0.0


def _part(J: Array, rate: Array, box: Box) -> float:
    """Return the part of minus ``rate`` (k,) that rows J v of a box on v can have, each alone."""
    lower, upper = (np.clip(side, -1e9, 1e9) for side in box)
    J = -np.sign(rate)[:, None] * J  # towards 0 error
    there, wanted = np.maximum(J * lower, J * upper).sum(axis=1), np.abs(rate)
    parts = np.divide(there, wanted, out=np.ones_like(wanted), where=wanted != 0.0)
    return float(np.clip(parts.min(), 0.0, 1.0))
