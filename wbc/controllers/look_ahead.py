"""Look-ahead: margins re-evaluated at the configuration that a command leads to.

Rows are only first-order. At full speed the second order takes a millimetre in a tick, and between
parallel surfaces the nearest points jump. So each solution is integrated: where a margin is
violated there, its rows at that configuration are added as cutting planes and the QP is solved
again, once. If that is not enough the step is scaled down; standing still is always allowed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from wbc.constraints.limits import Box
from wbc.constraints.rows import Bounds, Constraint, relax_for_contacts, stack
from wbc.constraints.validation import bounds_of, cutting_planes_of
from wbc.controllers.outcome import Outcome
from wbc.controllers.slack import Slacks
from wbc.laws import Rows
from wbc.robot import Snapshot
from wbc.validate import Array

# Of cutting planes in a tick. If the first was not enough, two more were in a sixth of 270 ticks
# from random states, and took up to 15 ms; the shipped problems need none.
ROUNDS = 1
# Names of steps that may be skipped when the deadline is over.
CUTS = "rows of margins where the command leads"
RELAXED = "margins relaxed by what contacts need"
# Scales of a step that are tried; checking one takes up to a millisecond.
STEP_SCALES = (1.0, 0.25, 0.0625)

Solve = Callable[[Bounds | None, Box | None], Outcome]


class MarginRows(NamedTuple):
    """The inequality rows of all constraints at one snapshot."""

    constraints: Sequence[Constraint]
    slacks: Slacks  # soft constraints are not looked ahead
    snapshot: Snapshot
    dt: float
    parts: Sequence[Bounds]  # the rows of each constraint, with slack weights where it may give way

    @classmethod
    def at(
        cls,
        snapshot: Snapshot,
        constraints: Sequence[Constraint],
        slacks: Slacks,
        dt: float,
        braked: bool = False,
    ) -> MarginRows:
        """Evaluate the constraints at ``snapshot``; ``braked``: nothing stops at once."""
        found = [bounds_of(one, snapshot, dt, braked) for one in constraints]
        parts = [slacks.soften(*both) for both in zip(constraints, found, strict=True)]
        return cls(constraints, slacks, snapshot, dt, parts)

    def violated(self, v: Array) -> list[Bounds]:
        """Return the rows of margins that are violated where ``v`` leads."""
        doubtful = [
            k
            for k, (constraint, part) in enumerate(zip(self.constraints, self.parts, strict=True))
            if self.slacks.is_hard(constraint.name) and constraint.may_violate(part, v, self.dt)
        ]
        if not doubtful:
            return []
        robot, step = self.snapshot.robot, (v, self.dt)
        there = robot.snapshot(robot.integrate(self.snapshot.q, *step))
        found = (
            cutting_planes_of(self.constraints[k], there, *step, self.parts[k]) for k in doubtful
        )
        return [cut for cut in found if cut is not None]

    def step_scale(self, v: Array) -> float:
        """Return the part of ``v`` that leads to no violation: one of ``STEP_SCALES``, or rest."""
        return next((scale for scale in STEP_SCALES if not self.violated(scale * v)), 0.0)


def solve_with_look_ahead(
    solve: Solve, margins: MarginRows, held: Callable[[], Rows], over: Callable[[], bool]
) -> Outcome:
    """Return the outcome with margins kept at its end, and its scale to command.

    ``solve``: solves all levels with some inequality rows, in a box on v+ (None: the limits').
    ``held``: returns the rows of the contacts: if a QP has no solution, margins are relaxed by what
    these need.
    ``over``: whether the deadline of the tick is over: nothing is solved again then.
    """
    outcome, rows, confirmed = solve_with_cuts(solve, margins, over)
    if not outcome.solved:
        if over():
            outcome.core_tick.skipped += (RELAXED,)
            return outcome
        conflict = outcome.solution.conflict
        if conflict is not None and not conflict.has_inequalities:
            return outcome
        relaxed = solve(relax_for_contacts(stack(rows), held()), outcome.box)
        # If neither has a solution, prefer the one proved infeasible.
        proved = conflict is not None and relaxed.solution.conflict is None
        return outcome if proved and not relaxed.solved else relaxed
    if confirmed:
        return outcome
    return outcome._replace(step_scale=margins.step_scale(outcome.velocity))


def solve_with_cuts(
    solve: Solve, margins: MarginRows, over: Callable[[], bool]
) -> tuple[Outcome, list[Bounds], bool]:
    """Return the outcome with cutting planes at violated margins, its rows, and if it is safe.

    After the last round, or when a QP has no solution, the outcome is returned unscaled: at the
    torque level a scaled command is no safer. The last value says whether the outcome was checked
    to violate no margin.
    """
    rows = list(margins.parts)
    outcome = solve(stack(rows), None)
    for _ in range(ROUNDS):
        if not outcome.solved:
            return outcome, rows, False
        found = margins.violated(outcome.velocity)
        if not found:
            return outcome, rows, True
        if over():
            outcome.core_tick.skipped += (CUTS,)
            return outcome, rows, False
        rows = rows + found
        outcome = solve(stack(rows), outcome.box)
    return outcome, rows, False
