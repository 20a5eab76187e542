"""Work is counted, never clocked: the same input does the same, on any machine and at any load.

A unit is about a microsecond of a quiet core. What a step takes is estimated by sizes and
iterations; solvers get as many iterations as what is left affords, and are not asked for what it
does not. Measured on 2,452 calls of DAQP, 2,424 solves of ProxQP and 87 searches for a conflict in
ticks from wild states.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from wbc.qp.problem import QP

# The part of a budget from which on attempts are quick.
_MOST = 0.65
# Fewer changes of an active set are no attempt; those that are needed are mostly fewer than HARD.
FEWEST, HARD = 25, 120
# What a search for rows in conflict mostly takes: steps, and units of each by the unknown.
_SEARCH, _SLACK_STEP = 40, 0.06


class Work:
    """The work of one tick, or of one call of a solver.

    Attributes
    ----------
    spent:
        Units so far.
    kept:
        Units that are left for what comes later.
    least:
        Units that attempts of a solver may take whatever is left, all together.
    left_out:
        What the budget did not afford, in words.
    """

    __slots__ = ("_budget", "kept", "least", "left_out", "spent")

    def __init__(self, budget: float = math.inf) -> None:
        self._budget = budget
        self.spent = self.kept = self.least = 0.0
        self.left_out: tuple[str, ...] = ()

    @property
    def is_limited(self) -> bool:
        """Whether there is a budget."""
        return self._budget < math.inf

    @property
    def short(self) -> bool:
        """Whether most of the budget is spent."""
        return self.spent > _MOST * self._budget

    @property
    def left(self) -> float:
        """Units that are left for an attempt of a solver."""
        rest = self._budget - self.spent
        return max(rest - self.kept, min(self.least, self.least + rest), 0.0)

    def has_room(self, units: float) -> bool:
        """Whether there is room for so much more, and what is kept."""
        return self.spent + self.kept + units <= self._budget

    def affords(self, units: float, what: str) -> bool:
        """Whether there is room for so much more; if not, ``what`` is left out."""
        if self.has_room(units):
            return True
        self.leave_out(what)
        return False

    def leave_out(self, what: str) -> None:
        """Note what is left out, in words."""
        if what not in self.left_out:
            self.left_out += (what,)


class Steps(NamedTuple):
    """What a call of a solver takes: to set it up, for each entry of its rows, for each step.

    A step takes so much for each unknown, and for each two of them.
    """

    call: float
    entry: float
    one: float = 0.0
    two: float = 0.0

    def step(self, n: int) -> float:
        """Return the units of a step with n unknowns."""
        return n * (self.one + self.two * n)

    def units(self, qp: QP, steps: int = 0) -> float:
        """Return the units of a call."""
        n = qp.g.size
        entries, step = n * (n + qp.b.size + qp.u.size), n * (self.one + self.two * n)
        return self.call + self.entry * entries + step * steps

    def afforded(self, qp: QP, left: float, most: int, least: int = 1) -> int:
        """Return how many steps ``left`` affords, ``most`` at most; 0: fewer than ``least``."""
        n = max(qp.g.size, 1)
        steps = min(most, (left - self.units(qp)) / (n * (self.one + self.two * n)))
        return int(steps) if steps >= min(least, most) else 0


# DAQP with the check of its answer, by changes of the active set; ProxQP from nothing and warm, by
# inner iterations, of which it takes up to six in an outer one; three steps of polishing.
ACTIVE_SET = Steps(70.0, 0.01, two=0.0014)
COLD = Steps(170.0, 0.03, one=0.4)
WARM = Steps(90.0, 0.03, one=0.4)
INNER = 6
POLISH = Steps(150.0, 0.1)


def search(qp: QP, steps: int = _SEARCH) -> float:
    """Return the units that a search for rows in conflict takes: DAQP's, with a slack for each."""
    size = qp.g.size + qp.b.size + qp.u.size
    return 150.0 + 2.0 * size + _SLACK_STEP * size * steps


def afforded_search(qp: QP, left: float, most: int) -> int:
    """Return how many steps of a search ``left`` units afford: some, and at most ``most``."""
    size = qp.g.size + qp.b.size + qp.u.size
    return int(min(most, max(_SEARCH, (left - search(qp, 0)) / (_SLACK_STEP * size))))


def otherwise(qp: QP) -> float:
    """Return the units of what comes where another solver does not do: DAQP, and a search."""
    return ACTIVE_SET.units(qp, HARD) + search(qp)
