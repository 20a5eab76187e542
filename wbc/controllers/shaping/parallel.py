"""Many searches at once, in this process and in others.

Every process takes the next start when it is done with one, this process among them: it need not
wait until others have loaded (:mod:`.team`), and a process that dies loses one search, which is
repeated here. New starts may be made of what was found; the others get them as they are made.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from wbc.controllers.shaping.nlp import Local, Nlp, Start
from wbc.controllers.shaping.outcome import ShapingStatistics, Stopped
from wbc.controllers.shaping.team import Team


class Errand(Protocol):
    """What is searched for."""

    @property
    def total(self) -> int:
        """How many searches there are to be, at most."""
        ...

    @property
    def reason(self) -> Stopped | None:
        """Why no more are needed; None if they are."""
        ...

    def more(self) -> Sequence[Start]:
        """Return the starts, after those returned before, that can be made by now."""
        ...

    def note(self, number: int, local: Local) -> bool:
        """Take what was found from the start of a number; return True if no more are needed."""
        ...


@dataclass(frozen=True, eq=False)
class Searches:
    """Results by the number of the start, and why some are missing."""

    found: dict[int, Local]
    stopped: Stopped | None

    def statistics(
        self, drawn: int, workers: int, build_seconds: float, search_seconds: float
    ) -> ShapingStatistics:
        """Return what the searches took."""
        return ShapingStatistics(
            drawn=drawn,
            searched=len(self.found),
            iterations=sum(local.iterations for local in self.found.values()),
            build_seconds=build_seconds,
            search_seconds=search_seconds,
            workers=workers,
            stopped=self.stopped,
        )


def search_all(nlp: Nlp, errand: Errand, team: Team) -> Searches:
    """Search from every start of an errand, here and by a team; Ctrl-C ends it with what there is.

    The first start is always searched from, others until the team's time is over.
    """
    found: dict[int, Local] = {}

    def note(number: int, local: Local) -> None:
        if number in found:
            return
        found[number] = local
        if errand.note(number, local):
            team.begin_no_more()

    with _Interruption() as interruption:
        try:
            searcher = nlp.searcher()
            while True:
                team.offer(errand.more())
                number = team.take()
                if number is None:
                    lost = team.lost(found)  # taken by a process that died
                    if not lost and len(found) == team.taken:
                        break
                    number = lost[0] if lost else None
                if number is not None:
                    note(number, searcher.search(team.start(number)))
                interruption.check()
                for result in team.results(wait_for_one=number is None):
                    note(*result)
        except KeyboardInterrupt:
            return Searches(found, Stopped.INTERRUPTED)
    if len(found) == errand.total:
        return Searches(found, None)
    return Searches(found, errand.reason or Stopped.SECONDS)


class _Interruption:
    """Keeps Ctrl-C until it is asked for.

    Inside a search CasADi turns the exception into a failure of IPOPT and goes on. Only the main
    thread can be told of signals; elsewhere they are left to it.
    """

    def __init__(self) -> None:
        self._pressed = False
        self._before: Any = None

    def __enter__(self) -> _Interruption:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._press)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _press(self, *signal_and_frame: object) -> None:
        self._pressed = True

    def check(self) -> None:
        """Raise KeyboardInterrupt if Ctrl-C was pressed."""
        if self._pressed:
            raise KeyboardInterrupt
