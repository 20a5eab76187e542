"""What the searches of one run came to, and when there have been enough of them.

Searches end in any order; what is concluded from them is not to depend on it. So every rule here is
about the numbers of the starts: one that decides at number n looks at what is before n.
"""

from __future__ import annotations

from collections.abc import Iterable

from wbc.controllers.shaping.closing import CLOSED
from wbc.controllers.shaping.outcome import Candidate, Rejected, Stopped
from wbc.controllers.shaping.verify import merged
from wbc.robot import Robot

# A cost is never negative: at this fraction of a middling posture's cost there is nothing to gain.
# Some more such postures are searched for all the same: perhaps not all can be reached.
MET, ENOUGH = 1e-12, 4
BETTER = 1e-3  # of the cost: what a posture must gain to count as better than the best before
UNCLOSED = "a sample stayed off the contacts"


class Verdicts:
    """Verdicts by the number of the start.

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
        self._found: dict[int, Candidate | Rejected] = {}
        self._met: list[int] = []  # numbers of the starts from which the tasks were met
        self._least: float | None = None
        self._contiguous = 0  # how many starts, the first ones, all have a verdict
        self._record = float("inf")  # among these: the least cost, as of the last that was better
        self._record_at = 0
        self._settled_at: int | None = None

    def add(self, number: int, verdict: Candidate | Rejected) -> bool:
        """Take a verdict, and return True if no more searches are needed."""
        self._found[number] = verdict
        if isinstance(verdict, Candidate):
            self._least = verdict.cost if self._least is None else min(self._least, verdict.cost)
            if verdict.cost * self._scale <= MET:
                self._met = sorted([*self._met, number])
        while self._settled_at is None and self._contiguous in self._found:
            self._go_on(self._contiguous)
            self._contiguous += 1
        return self._last() is not None

    def _go_on(self, number: int) -> None:
        """Look at the next verdict in the order of the starts."""
        verdict = self._found[number]
        if isinstance(verdict, Candidate) and verdict.cost < (1.0 - BETTER) * self._record:
            self._record, self._record_at = verdict.cost, number
        found_any = self._record < float("inf")
        if self._patience is not None and found_any and number >= self._record_at + self._patience:
            self._settled_at = number

    def __getitem__(self, number: int) -> Candidate | Rejected:
        """Return the verdict on a start that was searched from."""
        return self._found[number]

    @property
    def contiguous(self) -> int:
        """How many starts, the first ones, all have a verdict."""
        return self._contiguous

    @property
    def searched(self) -> int:
        """How many searches have ended."""
        return len(self._found)

    @property
    def least(self) -> float | None:
        """The least cost so far."""
        return self._least

    @property
    def reason(self) -> Stopped | None:
        """Why no more searches are needed, or None if they are."""
        if self._last() is None:
            return None
        return Stopped.MET if self._last() == self._last_met() else Stopped.SETTLED

    def candidates(self, robot: Robot) -> tuple[Candidate, ...]:
        """Return the distinct candidates, the best first.

        Once there have been enough, later starts do not count: which of them had been begun by
        then is chance, and the answer is not to depend on it.
        """
        return merged(robot, (one for one in self._counted() if isinstance(one, Candidate)))

    def rejected(self, unclosed: Iterable[float]) -> tuple[Rejected, ...]:
        """Return the starts that came to nothing, and the samples that were not searched from.

        As with :meth:`candidates`, only starts that count.
        """
        return (
            *(verdict for verdict in self._counted() if isinstance(verdict, Rejected)),
            *(
                Rejected(None, f"{UNCLOSED}: {gap:.2g} away (allowed {CLOSED:g})", UNCLOSED)
                for gap in unclosed
            ),
        )

    def _counted(self) -> list[Candidate | Rejected]:
        """Return the verdicts until there had been enough, in the order of the starts."""
        last = self._last()
        numbers = sorted(self._found) if last is None else range(last + 1)
        return [self._found[number] for number in numbers if number in self._found]

    def _last_met(self) -> int | None:
        return self._met[ENOUGH - 1] if len(self._met) >= ENOUGH else None

    def _last(self) -> int | None:
        """Return the number of the start with which there had been enough, or None."""
        ends = [end for end in (self._last_met(), self._settled_at) if end is not None]
        return min(ends, default=None)
