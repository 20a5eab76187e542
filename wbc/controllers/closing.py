"""Gears and loops at the end of a tick of the velocity level.

Their rows are linear, and mechanisms bend: at 1 rad/s a bar of 0.3 m misses its pin by 4 um after
5 ms. So the tick looks where its command leads, adds what the rows missed to the errors, and is
done again, until the loops are closed there (Newton's method with the tick's own matrices).

And a robot may begin with a gear or loop that is off, as measured after power-up. All of that in
one tick may be faster than the limits allow; then as much of it is taken back as they do.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

import numpy as np

from wbc.constraints.mechanics import BoltedBase, ClosedLoop, Gear, Mechanics
from wbc.controllers.loop_gaps import LoopGaps
from wbc.controllers.outcome import Box
from wbc.controllers.tick import Tick
from wbc.robot import Snapshot
from wbc.tasks.task import Task
from wbc.validate import Array

CLOSED = 1e-10  # m, rad: smaller gaps at the end of a tick stay
ROUNDS = 5  # each leaves a gap by that part which joints move in a tick [rad]
OFF = 1e-9  # m, rad: smaller errors are no reason why a tick cannot be had
FAR = 1.0  # m, rad: a larger gap is no matter of curvature
DEPENDENT = 1e-6  # singular values below this part of the largest: rows that follow from others
HALVINGS = 6  # of the part of errors that is taken back
REST = "what loops miss to second order"
INSIDE = 1.0 - 1e-9  # of what limits allow

Step = Callable[[Snapshot], Tick]


class LoopClosing:
    """What the velocity level does for the gears and loops among its contacts.

    Attributes
    ----------
    parts:
        All of them.
    curved:
        Those whose rows are linear in the command to first order only, gears first.
    busy:
        Whether a tick is being done again.
    lock:
        Held while one is: threads that share a controller take turns.
    """

    def __init__(self, contacts: Sequence[Task], dt: float) -> None:
        parts = [one for one in contacts if isinstance(one, Mechanics)]
        self.parts = tuple(one for one in parts if not isinstance(one, BoltedBase))
        self.curved = tuple(
            one
            for one in self.parts
            if isinstance(one, ClosedLoop) or (isinstance(one, Gear) and not one.is_linear)
        )
        self._dt, self.busy, self.lock = dt, False, threading.RLock()
        self._gaps: LoopGaps | None = None
        # Whether rows of loops follow from others': second-order errors then contradict each other.
        self._dependent = False

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (self.parts, self._dt)  # a copy has a lock of its own

    def closed(
        self, snapshot: Snapshot, tick: Tick, step: Step, is_over: Callable[[], bool]
    ) -> Tick:
        """Return the tick whose command ends with closed loops; ``step`` does it again.

        Not once the deadline ``is_over``: what is open then is taken back in the next tick.
        """
        found = tick
        self.busy = True
        try:
            for _ in range(ROUNDS):
                missed = self._gaps_after(snapshot, self._dt * found.velocity)
                worst = max([float(np.abs(error).max()) for error in missed])
                if worst <= CLOSED or not worst < FAR:
                    break
                if is_over():
                    found.__dict__["left_out"] = (*found.left_out, REST)
                    break
                before = [one.added for one in self.curved]
                if self._dependent:
                    missed = self._reached(snapshot, missed)
                again = self._with(snapshot, before, missed, step)
                if not again.ok and not self._dependent:
                    self._dependent = True
                    missed = self._reached(snapshot, missed)
                    again = self._with(snapshot, before, missed, step)
                if not again.ok:
                    break
                found = again
        finally:
            self._forget()
        return found

    def _gaps_after(self, snapshot: Snapshot, step: Array) -> list[Array]:
        """Return the gaps of :attr:`curved` parts where a displacement (nv,) leads."""
        if self._gaps is None:
            loops = [one for one in self.curved if isinstance(one, ClosedLoop)]
            self._gaps = LoopGaps(snapshot.robot, loops) if loops else None
        found = [] if self._gaps is None else self._gaps.after(snapshot.q, step)
        gears = self.curved[: len(self.curved) - len(found)]
        if not gears:
            return found
        q = snapshot.robot.integrate(snapshot.q, step, 1.0)
        there = snapshot.robot.snapshot(q)
        return [one.gap(there) for one in gears] + found

    def _with(
        self, snapshot: Snapshot, added: Sequence[Array], more: Sequence[Array], step: Step
    ) -> Tick:
        for one, before, error in zip(self.curved, added, more, strict=True):
            one.add(before + error)
        return step(snapshot)

    def _reached(self, snapshot: Snapshot, errors: Sequence[Array]) -> list[Array]:
        """Return the parts of errors that rows can give together."""
        J = np.concatenate([one.residual(snapshot).jacobian for one in self.curved])
        U, sizes, _ = np.linalg.svd(J, full_matrices=False)
        U = U[:, sizes > DEPENDENT * sizes.max(initial=0.0)]
        together = U @ (U.T @ np.concatenate(errors))
        return np.split(together, np.cumsum([one.size for one in errors])[:-1])

    def within_reach(
        self, snapshot: Snapshot, box: Box, step: Step
    ) -> tuple[Tick, list[str]] | None:
        """Return a tick that takes back as much of the errors as limits allow, and whose.

        None: that is not why the tick cannot be had.
        """
        residuals = [one.residual(snapshot) for one in self.parts]
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
                return found, self._late(parts)
            for _ in range(HALVINGS):
                middle = 0.5 * (least + most)
                tried = self._tried(snapshot, errors, middle * np.array(parts), step)
                if tried.ok:
                    least, found = middle, tried
                else:
                    most = middle
            if not found.ok:
                found = self._tried(snapshot, errors, np.zeros(len(parts)), step)
            return found, [one.name for one in self.parts]
        finally:
            self._forget()

    def _tried(self, snapshot: Snapshot, errors: Sequence[Array], parts: Array, step: Step) -> Tick:
        for one, error, part in zip(self.parts, errors, parts.tolist(), strict=True):
            one.add((part - 1.0) * error)
        return step(snapshot)

    def _late(self, parts: Sequence[float]) -> list[str]:
        return [one.name for one, part in zip(self.parts, parts, strict=True) if part < 1.0]

    def _forget(self) -> None:
        self.busy = False
        for one in self.parts:
            one.add(np.zeros(len(one.rows)))


def _part(J: Array, rate: Array, box: Box) -> float:
    """Return the part of minus ``rate`` (k,) that rows J v of a box on v can have, each alone."""
    lower, upper = (np.clip(side, -1e9, 1e9) for side in box)
    most = np.where(J > 0.0, J * upper, J * lower).sum(axis=1)
    least = np.where(J > 0.0, J * lower, J * upper).sum(axis=1)
    there = np.where(rate > 0.0, -least, most)  # towards 0 error
    wanted = np.abs(rate)
    parts = np.divide(there, wanted, out=np.ones_like(wanted), where=wanted > 0.0)
    return float(np.clip(parts.min(), 0.0, 1.0))
