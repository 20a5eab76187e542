"""What the searches of one run came to, collected as they end."""

from __future__ import annotations

from collections.abc import Callable

from wbc.controllers.shaping.nlp import BuiltNlp, Local
from wbc.controllers.shaping.outcome import Candidate, Rejected
from wbc.controllers.shaping.starts import CLOSED, Starts
from wbc.controllers.shaping.verify import judged, merged

# Called with searches done, searches in all, and the least cost so far (None: nothing yet).
Progress = Callable[[int, int, float | None], None]
# A cost is never negative: at this fraction of a middling posture's cost there is nothing to gain.
# Some more such postures are searched for all the same: perhaps not all can be reached.
MET, ENOUGH = 1e-12, 4
UNCLOSED = "a sample stayed off the contacts"


class Verdicts:
    """Verdicts by the number of the start."""

    def __init__(self, built: BuiltNlp, starts: Starts, progress: Progress | None) -> None:
        self._built, self._starts, self._progress = built, starts, progress
        self._found: dict[int, Candidate | Rejected] = {}

    def note(self, number: int, local: Local) -> bool:
        """Judge what a search found, and return True if the others need not be made."""
        start = self._starts.starts[number]
        self._found[number] = judged(self._built, number, start, local)
        if self._progress is not None:
            least = min((candidate.cost for candidate in self._candidates()), default=None)
            self._progress(len(self._found), len(self._starts.starts), least)
        return len(self._met()) >= ENOUGH

    @property
    def searched(self) -> int:
        """How many searches have ended."""
        return len(self._found)

    def candidates(self) -> tuple[Candidate, ...]:
        """Return the distinct candidates, the best first.

        Once the tasks were met often enough, later starts do not count: which of them had been
        begun by then is chance, and the answer is not to depend on it.
        """
        met = self._met()
        last = met[ENOUGH - 1] if len(met) >= ENOUGH else len(self._starts.starts)
        counted = (c for c in self._candidates() if c.starts[0] <= last)
        return merged(self._built.unknowns.problem.robot, counted)

    def rejected(self) -> tuple[Rejected, ...]:
        """Return the starts that came to nothing, and the samples that were not searched from."""
        found = [self._found[number] for number in sorted(self._found)]
        return (
            *(verdict for verdict in found if isinstance(verdict, Rejected)),
            *(
                Rejected(None, f"{UNCLOSED}: {gap:.2g} away (allowed {CLOSED:g})", UNCLOSED)
                for gap in self._starts.unclosed
            ),
        )

    def _candidates(self) -> list[Candidate]:
        return [verdict for verdict in self._found.values() if isinstance(verdict, Candidate)]

    def _met(self) -> list[int]:
        """Return the numbers of the starts from which the tasks were met."""
        met = (c for c in self._candidates() if c.cost * self._starts.scale <= MET)
        return sorted(candidate.starts[0] for candidate in met)
