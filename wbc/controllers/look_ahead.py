"""Look-ahead: margins re-evaluated at the configuration that a command leads to.

Rows are only first-order. At full speed the second order takes a millimetre in a tick, and between
parallel surfaces the nearest points jump. So each solution is integrated: where a margin is
violated there, its rows at that configuration are added as cutting planes and the QP is solved
again, once. If that is not enough the step is scaled down; standing still is always allowed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from wbc.constraints.returned import bounds_of, cuts_of
from wbc.constraints.rows import Bounds, Constraint, relax_for_contacts, stack
from wbc.controllers.levels import TOLERANCE, Outcome
from wbc.controllers.slack import Slacks
from wbc.laws import Rows
from wbc.qp.work import Work
from wbc.robot import Snapshot
from wbc.validate import Array

# Of cutting planes in a tick. Where the first did not do, two more did in a sixth of 270 ticks from
# wild states, and took up to 15 ms; problems as they are shipped need none.
ROUNDS = 1
# Parts of a step that are tried; each is looked at for up to a millisecond.
SCALES = (1.0, 0.25, 0.0625)
# Units of work: to look where a command leads, for each row, and for each pair of bodies inside.
LOOK, ROW, INSIDE = 100.0, 3.0, 30.0
# And to solve the first level again with cuts, for each unknown.
AGAIN = 10.0
CUTS = "rows of margins where the command leads"

Box = tuple[Array, Array]
Solve = Callable[[Bounds | None, Box | None], Outcome]


class MarginRows(NamedTuple):
    """The inequality rows of all constraints at one snapshot.

    Attributes
    ----------
    parts:
        The rows of each constraint, with slack weights where it may give way.
    slacks:
        Which may: where they lead is not looked at.
    """

    constraints: Sequence[Constraint]
    slacks: Slacks
    snapshot: Snapshot
    dt: float
    parts: Sequence[Bounds]
    work: Work

    @property
    def look(self) -> float:
        """Units of work that it takes to look at margins once."""
        work = LOOK
        for part in self.parts:
            work += ROW * part.lower.size
            if part.distances is not None:
                work += INSIDE * np.count_nonzero(part.distances.clearance < 0.0)
        return work

    @classmethod
    def at(
        cls,
        snapshot: Snapshot,
        constraints: Sequence[Constraint],
        slacks: Slacks,
        dt: float,
        work: Work | None = None,
        braked: bool = False,
    ) -> MarginRows:
        """Evaluate the constraints at ``snapshot``; ``braked``: nothing stops at once."""
        work = Work() if work is None else work
        found = [bounds_of(one, snapshot, dt, braked) for one in constraints]
        parts = [slacks.soften(*both) for both in zip(constraints, found, strict=True)]
        margins = cls(constraints, slacks, snapshot, dt, parts, work)
        work.spent += margins.look
        return margins

    def violated(self, v: Array) -> list[Bounds]:
        """Return the rows of margins that are violated where ``v`` leads."""
        return [cut for _, cut in self._cuts(v, self._doubtful(v))]

    def step_scale(self, v: Array, scales: Sequence[float] = SCALES) -> float:
        """Return the part of ``v`` that leads to no violation: one of ``scales``, or rest.

        Where there is no time to look, one that bounds on the curvature show to be safe.
        """
        suspect: tuple[int, Bounds] | None = None
        for scale in scales:
            doubtful = self._doubtful(scale * v)
            if doubtful and not self.work.affords(self.look, f"a look at {scale:.0%} of the step"):
                continue
            suspect = next(self._cuts(scale * v, doubtful, suspect), None)
            if suspect is None:
                return scale
        return 0.0

    def _doubtful(self, v: Array) -> list[int]:
        """Return which constraints may be violated where ``v`` leads."""
        return [
            k
            for k, (constraint, part) in enumerate(zip(self.constraints, self.parts, strict=True))
            if self.slacks.is_hard(constraint.name) and constraint.may_violate(part, v, self.dt)
        ]

    def _cuts(
        self, v: Array, doubtful: Sequence[int], suspect: tuple[int, Bounds] | None = None
    ) -> Iterator[tuple[int, Bounds]]:
        """Yield the rows of ``doubtful`` margins that are violated where ``v`` leads.

        ``suspect`` is what was violated elsewhere: looked at first, for less, and enough.
        """
        if not doubtful:
            return
        self.work.spent += self.look
        robot, step = self.snapshot.robot, (v, self.dt)
        there = robot.snapshot(robot.integrate(self.snapshot.q, *step))
        if suspect is not None:
            k, cut = suspect
            if self.constraints[k].still_violated(there, *step, self.parts[k], cut):
                yield suspect
                return
        for k in doubtful:
            found = cuts_of(self.constraints[k], there, *step, self.parts[k])
            if found is not None:
                yield k, found


class Attempt(NamedTuple):
    """What came of a tick's QP with everything kept.

    Attributes
    ----------
    rows:
        Of the margins in it, cutting planes too.
    step_scale:
        The part of the solution that is safe to command.
    """

    outcome: Outcome
    rows: list[Bounds]
    step_scale: float = 1.0


def solve_with_look_ahead(solve: Solve, margins: MarginRows, held: Sequence[Rows]) -> Attempt:
    """Return the outcome with margins kept where it leads, and the part of it to command.

    Parameters
    ----------
    solve:
        Solves all levels with some inequality rows, in a box on v+ (None: the limits').
    held:
        Rows of the contacts: if a QP has no solution, margins are relaxed by what these need.
    """
    outcome, rows, scales = solve_with_cuts(solve, margins)
    margins.work.kept = 0.0
    if not outcome.solved:
        conflict = outcome.solution.conflict
        # It is not for want of room if a level above had it, or if the solver came to a point in
        # it, only not to the best: weights stall it then, with margins relaxed as well.
        room = outcome.qp is not outcome.first or outcome.solution.residuals.primal <= TOLERANCE
        if room or (conflict is not None and not conflict.has_inequalities):
            return Attempt(outcome, rows)
        relaxed = solve(relax_for_contacts(stack(rows), held), outcome.box)
        # Of two without a solution the one that is proved to have none.
        proved = conflict is not None and relaxed.solution.conflict is None
        return Attempt(outcome if proved and not relaxed.solved else relaxed, rows)
    return Attempt(outcome, rows, margins.step_scale(outcome.velocity, scales) if scales else 1.0)


def solve_with_cuts(
    solve: Solve, margins: MarginRows
) -> tuple[Outcome, list[Bounds], Sequence[float]]:
    """Return the outcome with margins kept where it leads, and the rows that this took.

    After the last round, or when a QP has no solution, the outcome is returned as it is: at the
    torque level no part of a command is safer than the whole. The last thing returned is which
    parts of the outcome are to be looked at: none if it was, and violates no margin.
    """
    rows, work = list(margins.parts), margins.work
    work.kept = margins.look  # by levels below: where nobody looks, rest is all that is safe
    outcome = solve(stack(rows), None)
    for _ in range(ROUNDS):
        if not outcome.solved:
            return outcome, rows, ()
        found = margins.violated(outcome.velocity)
        if not found:
            return outcome, rows, ()
        if not work.affords(AGAIN * outcome.qp.g.size, CUTS):
            return outcome, rows, SCALES[1:]
        again = solve(stack([*rows, *found]), outcome.box)
        if work.short and not again.solved:  # not all was tried: a part of the first answer
            work.leave_out(CUTS)
            return outcome, rows, SCALES[1:]
        outcome, rows = again, rows + found
    return outcome, rows, SCALES
