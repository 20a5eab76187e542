"""Multi-start: from which postures searches begin, what came of them, and when it is enough.

The first starts are spread over all postures; later ones are hops from the best that were found by
then. A hop waits for no search among the last few before it, so that several processes always have
something to do; and it looks at no other than those before these, so that the hops are the same
however many processes search. Searches end in any order, and what is concluded from them does not
depend on it: a rule that decides at number n looks at what is before n.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wbc.shaping.basin_hopping import BasinHopping, Elite
from wbc.shaping.evaluation import evaluate, merged
from wbc.shaping.nlp import BuiltNlp, Local, Start
from wbc.shaping.outcome import Candidate, Rejected, Stopped
from wbc.shaping.starts import CLOSED, Sampling, make_starts
from wbc.validate import Array

# Called with searches done, searches in all, and the least cost so far (None: nothing yet).
Progress = Callable[[int, int, float | None], None]
SPREAD = 24  # starts, before the hops begin
LAG = 16  # searches before a hop of which it does not know
# A cost is never negative: at this fraction of a middling posture's cost there is nothing to gain.
# Some more such postures are searched for all the same: perhaps not all can be reached.
MET, ENOUGH = 1e-12, 4
BETTER = 1e-3  # of the cost: what a posture must gain to count as better than the best before
UNCLOSED = "a sample stayed off the contacts"


class StoppingRule:
    """Results by the number of the start, and with which of them there are enough.

    Parameters
    ----------
    scale:
        The factor that makes the cost of a middling posture 1.
    patience:
        After how many searches in a row without a better posture there have been enough; None: no
        number is.
    """

    def __init__(self, scale: float, patience: int | None) -> None:
        self._scale, self._patience = scale, patience
        self.found: dict[int, Candidate | Rejected] = {}
        self._met: list[int] = []  # numbers of the starts from which the tasks were met
        self.least: float | None = None  # cost so far
        self.contiguous = 0  # how many starts, the first ones, all have a result
        self._record = float("inf")  # of those: the least cost, as of the last that was better
        self._record_at = 0
        self._settled_at: int | None = None

    def add(self, number: int, result: Candidate | Rejected) -> None:
        """Take the result of a start."""
        self.found[number] = result
        if isinstance(result, Candidate):
            self.least = result.cost if self.least is None else min(self.least, result.cost)
            if result.cost * self._scale <= MET:
                self._met = sorted([*self._met, number])
        while self._settled_at is None and self.contiguous in self.found:
            self._advance(self.contiguous)
            self.contiguous += 1

    def _advance(self, number: int) -> None:
        """Look at the next result in the order of the starts."""
        result = self.found[number]
        if isinstance(result, Candidate) and result.cost < (1.0 - BETTER) * self._record:
            self._record, self._record_at = result.cost, number
        found_any = self._record < float("inf")
        if self._patience is not None and found_any and number >= self._record_at + self._patience:
            self._settled_at = number

    @property
    def last(self) -> int | None:
        """The number of the start with which there are enough, or None."""
        ends = [end for end in (self._last_met(), self._settled_at) if end is not None]
        return min(ends, default=None)

    @property
    def reason(self) -> Stopped | None:
        """Why no more searches are needed, or None if they are."""
        if self.last is None:
            return None
        return Stopped.MET if self.last == self._last_met() else Stopped.SETTLED

    def counted(self) -> list[Candidate | Rejected]:
        """Return the results until there were enough, in the order of the starts.

        Later ones do not count: which of them had been begun by then is chance, and the answer is
        not to depend on it.
        """
        last = self.last
        return [self.found[k] for k in sorted(self.found) if last is None or k <= last]

    def _last_met(self) -> int | None:
        return self._met[ENOUGH - 1] if len(self._met) >= ENOUGH else None


class MultiStart:
    """Makes starts, and collects the results of the searches from them.

    ``spread`` are the first ones, ``rule`` says when there are enough.
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
        self.spread = make_starts(sampling, min(total, SPREAD), seed)
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
        """Return the starts, after those returned before, that can be made by now."""
        while len(self._starts) < self.total and self.rule.contiguous >= len(self._starts) - LAG:
            self._starts.append(self._hop(len(self._starts)))
        ready = self._starts[self._handed_out :]
        self._handed_out = len(self._starts)
        return ready

    def record(self, number: int, local: Local) -> None:
        """Evaluate what a search found."""
        self.rule.add(number, evaluate(self._built, number, self._starts[number], local))
        if self._progress is not None:
            self._progress(len(self.rule.found), self.total, self.rule.least)

    def candidates(self) -> tuple[Candidate, ...]:
        """Return the distinct candidates, the best first."""
        counted = self.rule.counted()
        return merged(self._robot, (one for one in counted if isinstance(one, Candidate)))

    def rejected(self) -> tuple[Rejected, ...]:
        """Return the starts that came to nothing, and the samples that were not searched from."""
        lost = [one for one in self.rule.counted() if isinstance(one, Rejected)]
        for gap in self.spread.unclosed:
            reason = f"{UNCLOSED}: {gap:.2g} away (allowed {CLOSED:g})"
            lost.append(Rejected(None, reason, UNCLOSED))
        return tuple(lost)

    def _hop(self, number: int) -> Start:
        while self._known < number - LAG:
            result = self.rule.found[self._known]
            if isinstance(result, Candidate):
                self._elite.add(result)
            self._known += 1
        return self._hopping.start(number, self._elite.best)
