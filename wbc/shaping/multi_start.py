"""Multi-start: the starts of searches, their results, and the stopping rule.

The first starts are spread over all postures; later ones are hops from the best found so far. A hop
does not wait for the last few searches before it, so that all processes stay busy; and it uses only
results before these, so that the hops do not depend on the number of processes. Searches end in any
order, and conclusions do not depend on it: a rule at number n uses results before n only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wbc.shaping.basin_hopping import BasinHopping, Elite
from wbc.shaping.evaluation import evaluate, merge_duplicates
from wbc.shaping.nlp import BuiltNlp, LocalOptimum, Start
from wbc.shaping.outcome import Candidate, Rejected, Stopped
from wbc.shaping.starts import CLOSED, Sampling, make_starts
from wbc.validate import Array

# Called with searches done, searches in all, and the least cost so far (None: nothing yet).
Progress = Callable[[int, int, float | None], None]
SPREAD_STARTS = 24  # before the hops begin
HOP_LAG = 16  # searches before a hop whose results it does not use
# Costs are nonnegative: below this share of a median posture's cost they count as zero. The search
# stops after several such postures, because not all may be reachable.
ZERO_COST, ENOUGH_ZEROS = 1e-12, 4
IMPROVEMENT = 1e-3  # of the cost: least gain over the best so far that counts as better
NOT_PROJECTED = "a sample stayed off the contacts"


class StoppingRule:
    """Results by the number of the start, and at which of them the search stops.

    ``scale``: the factor that makes the cost of a median posture 1.
    ``patience``: stop after so many searches in a row without a better posture; None: never.
    """

    def __init__(self, scale: float, patience: int | None) -> None:
        self._scale, self._patience = scale, patience
        self.found: dict[int, Candidate | Rejected] = {}
        self._zero_costs: list[int] = []  # numbers of the starts whose search met the tasks
        self.least: float | None = None  # cost so far
        self.contiguous = 0  # how many starts, the first ones, all have a result
        self._record = float("inf")  # of those: the least cost, as of the last that was better
        self._record_at = 0
        self._settled_at: int | None = None

    def add(self, number: int, result: Candidate | Rejected) -> None:
        """Add the result of a start."""
        self.found[number] = result
        if isinstance(result, Candidate):
            self.least = result.cost if self.least is None else min(self.least, result.cost)
            if result.cost * self._scale <= ZERO_COST:
                self._zero_costs = sorted([*self._zero_costs, number])
        while self._settled_at is None and self.contiguous in self.found:
            one, at = self.found[self.contiguous], self.contiguous
            if isinstance(one, Candidate) and one.cost < (1.0 - IMPROVEMENT) * self._record:
                self._record, self._record_at = one.cost, at
            if self._patience is not None and self._record < float("inf"):
                self._settled_at = at if at >= self._record_at + self._patience else None
            self.contiguous += 1

    @property
    def last(self) -> int | None:
        """The number of the start at which the search stops, or None."""
        ends = [end for end in (self._last_zero_cost(), self._settled_at) if end is not None]
        return min(ends, default=None)

    @property
    def reason(self) -> Stopped | None:
        """Why no more searches are needed, or None if they are."""
        if self.last is None:
            return None
        return Stopped.MET if self.last == self._last_zero_cost() else Stopped.SETTLED

    def results_until_stop(self) -> list[Candidate | Rejected]:
        """Return the results until the search stopped, in the order of the starts.

        Later ones are ignored: how many of them were started is chance, and the answer must not
        depend on it.
        """
        last = self.last
        return [self.found[k] for k in sorted(self.found) if last is None or k <= last]

    def _last_zero_cost(self) -> int | None:
        return self._zero_costs[ENOUGH_ZEROS - 1] if len(self._zero_costs) >= ENOUGH_ZEROS else None


class MultiStart:
    """Makes starts, and collects the results of the searches from them.

    ``spread`` are the first ones, ``rule`` decides when to stop.
    """

    def __init__(
        self,
        built: BuiltNlp,
        q_start: Array,
        total: int,
        patience: int | None,
        seed: int,
        progress: Progress | None,
    ) -> None:
        self.total = total
        self._built, self._progress = built, progress
        sampling = Sampling.of(built, q_start)
        self.spread = make_starts(sampling, min(total, SPREAD_STARTS), seed)
        self._starts = list(self.spread.starts)
        self._handed_out = 0
        self._hopping = BasinHopping(sampling, self.spread.scale, seed)
        self._robot = sampling.robot
        self._elite = Elite(sampling.robot)
        self._known = 0  # how many results, the first ones, the elite was chosen from
        self.rule = StoppingRule(self.spread.scale, patience)

    def needs(self, number: int) -> bool:
        """Return whether the answer depends on the search from the start of a number."""
        return self.rule.last is None or number <= self.rule.last

    def next_starts(self) -> Sequence[Start]:
        """Return the next starts that can be made from the results so far."""
        while (
            len(self._starts) < self.total and self.rule.contiguous >= len(self._starts) - HOP_LAG
        ):
            self._starts.append(self._hop(len(self._starts)))
        ready = self._starts[self._handed_out :]
        self._handed_out = len(self._starts)
        return ready

    def record(self, number: int, local: LocalOptimum) -> None:
        """Evaluate and store the result of a search."""
        self.rule.add(number, evaluate(self._built, number, self._starts[number], local))
        if self._progress is not None:
            self._progress(len(self.rule.found), self.total, self.rule.least)

    def candidates(self) -> tuple[Candidate, ...]:
        """Return the distinct candidates, the best first."""
        results_until_stop = self.rule.results_until_stop()
        return merge_duplicates(
            self._robot, (one for one in results_until_stop if isinstance(one, Candidate))
        )

    def rejected(self) -> tuple[Rejected, ...]:
        """Return the rejected starts, and samples from which no search began."""
        lost = [one for one in self.rule.results_until_stop() if isinstance(one, Rejected)]
        for gap in self.spread.unclosed:
            reason = f"{NOT_PROJECTED}: {gap:.2g} away (allowed {CLOSED:g})"
            lost.append(Rejected(None, reason, NOT_PROJECTED))
        return tuple(lost)

    def _hop(self, number: int) -> Start:
        while self._known < number - HOP_LAG:
            result = self.rule.found[self._known]
            if isinstance(result, Candidate):
                self._elite.add(result)
            self._known += 1
        return self._hopping.start(number, self._elite.best)
