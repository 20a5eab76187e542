"""Where a command leads: looked at before it is given, because rows are linear and bodies turn.

A row keeps a distance to first order. At full speed the second order takes a millimetre in a tick,
and between parallel surfaces the nearest points jump. So each solution is tried on the robot: where
a margin is broken, the rows of that place join the others and the QP is solved again (Newton's way
to the edge of what is allowed). If a few rounds do not do, only a part of the step is taken;
standing still is always allowed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from wbc.constraints.rows import Bounds, Constraint, giving_way, joined
from wbc.controllers.softness import Softness
from wbc.laws import Rows
from wbc.robot import Snapshot
from wbc.validate import Array

ROUNDS = 3
SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625)


@dataclass(slots=True)
class Landing:
    """The inequality rows of one tick, which grow as places are looked at.

    Attributes
    ----------
    bounds:
        The rows so far; None without constraints.
    rounds:
        How often rows were added.
    loose:
        Whether they gave way to contacts.
    """

    constraints: Sequence[Constraint]
    softness: Softness
    snapshot: Snapshot
    dt: float
    contacts: Sequence[Rows]
    parts: list[Bounds]
    bounds: Bounds | None
    rounds: int = 0
    loose: bool = False
    cuts: list[Bounds] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        constraints: Sequence[Constraint],
        softness: Softness,
        snapshot: Snapshot,
        dt: float,
        contacts: Sequence[Rows],
    ) -> Landing:
        """Return the rows of the constraints at ``snapshot``, with those of its contacts."""
        parts = [softness.soften(part, part.rows(snapshot, dt)) for part in constraints]
        bounds = joined(parts) if parts else None
        return cls(constraints, softness, snapshot, dt, contacts, parts, bounds)

    def breaks(self, v: Array) -> bool:
        """Look where ``v`` leads and add rows that keep it from there; False if none are needed."""
        if self.bounds is None or self.rounds >= ROUNDS:
            return False
        found = self.look(v)
        if not found:
            return False
        self.rounds += 1
        self.cuts += found
        self.bounds = joined([*self.parts, *self.cuts])
        return True

    def yields(self) -> bool:
        """Loosen the rows for contacts, after a QP that was not solved; False if that is done."""
        if self.bounds is None or self.loose:
            return False
        self.loose, self.rounds = True, ROUNDS
        self.bounds = giving_way(self.bounds, self.contacts)
        return True

    def share(self, v: Array) -> float:
        """Return the part of ``v`` that may be commanded: 1 unless all rounds were in vain."""
        if self.rounds < ROUNDS or self.loose:
            return 1.0
        return next((part for part in SHARES if not self.look(part * v)), 0.0)

    def look(self, v: Array) -> list[Bounds]:
        """Return the rows of margins that are broken where ``v`` leads."""
        doubtful = [
            (constraint, part)
            for constraint, part in zip(self.constraints, self.parts, strict=True)
            if self.softness.is_hard(constraint.name) and constraint.doubts(part, v, self.dt)
        ]
        if not doubtful:
            return []
        robot = self.snapshot.robot
        there = robot.snapshot(robot.integrate(self.snapshot.q, v, self.dt))
        found = [constraint.cuts(there, v, self.dt, part) for constraint, part in doubtful]
        return [cut for cut in found if cut is not None]
