"""From which postures searches begin, one after the other, and what came of them.

The first starts are spread over all postures; later ones are hops from the best that were found by
then. A hop waits for no search among the last few before it, so that several processes always have
something to do; and it looks at no other than those before these, so that the hops are the same
however many processes search.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wbc.controllers.shaping.hopping import Hops, Parents
from wbc.controllers.shaping.nlp import BuiltNlp, Local, Start
from wbc.controllers.shaping.outcome import Candidate, Rejected, Stopped
from wbc.controllers.shaping.starts import Sampling, make_starts
from wbc.controllers.shaping.verdicts import Verdicts
from wbc.controllers.shaping.verify import judged
from wbc.validate import Array

# Called with searches done, searches in all, and the least cost so far (None: nothing yet).
Progress = Callable[[int, int, float | None], None]
SPREAD = 24  # starts, before the hops begin
LAG = 16  # searches before a hop of which it does not know


class Hunt:
    """Makes starts, and takes what was found from them."""

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
        self._spread = make_starts(sampling, min(total, SPREAD), seed)
        self._starts = list(self._spread.starts)
        self._handed_out = 0
        self._hops = Hops(sampling, self._spread.scale, seed)
        self._parents = Parents(sampling.robot)
        self._known = 0  # how many verdicts, the first ones, the parents were chosen from
        self._verdicts = Verdicts(self._spread.scale, patience)

    @property
    def drawn(self) -> int:
        """How many samples were drawn for the first starts."""
        return self._spread.drawn

    @property
    def searched(self) -> int:
        """How many searches have ended."""
        return self._verdicts.searched

    @property
    def reason(self) -> Stopped | None:
        """Why no more searches are needed, or None if they are."""
        return self._verdicts.reason

    def more(self) -> Sequence[Start]:
        """Return the starts, after those returned before, that can be made by now."""
        while len(self._starts) < self.total and self._ripe():
            self._starts.append(self._hop(len(self._starts)))
        ready = self._starts[self._handed_out :]
        self._handed_out = len(self._starts)
        return ready

    def note(self, number: int, local: Local) -> bool:
        """Judge what a search found, and return True if no more are needed."""
        verdict = judged(self._built, number, self._starts[number], local)
        enough = self._verdicts.add(number, verdict)
        if self._progress is not None:
            self._progress(self.searched, self.total, self._verdicts.least)
        return enough

    def candidates(self) -> tuple[Candidate, ...]:
        """Return the distinct candidates, the best first."""
        return self._verdicts.candidates(self._built.unknowns.problem.robot)

    def rejected(self) -> tuple[Rejected, ...]:
        """Return the starts that came to nothing, and the samples that were not searched from."""
        return self._verdicts.rejected(self._spread.unclosed)

    def _ripe(self) -> bool:
        """Return True if the next hop may be made."""
        return self._verdicts.contiguous >= len(self._starts) - LAG

    def _hop(self, number: int) -> Start:
        while self._known < number - LAG:
            verdict = self._verdicts[self._known]
            if isinstance(verdict, Candidate):
                self._parents.add(verdict)
            self._known += 1
        return self._hops.start(number, self._parents.best)
