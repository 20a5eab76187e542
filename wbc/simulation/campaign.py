"""Pushes from all sides, ever harder, in parallel processes: which are survived.

A grid, and not a bisection only: a robot may survive a push and fall by a smaller one, and where it
does so is a finding. Which pushes are tried depends on the outcomes, not on the workers. Outcomes
are kept in a file, one line as each comes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.journal import Journal, not_ours
from wbc.kinds import whole_number
from wbc.validate import Array, finite_number, finite_vector, read_only, real_array, set_fields
from wbc.workers import Workers

MOMENT = 0.1  # s to wait for an outcome, before looking whether the campaign is to end
DIGITS = 9  # to which angles and ratios tell pushes apart


class PushOutcome(NamedTuple):
    """What became of one push.

    Attributes
    ----------
    angle:
        Direction in the horizontal plane [rad]: 0 is along world x.
    ratio:
        Impulse in parts of M omega d of this direction.
    impulse:
        [N s].
    survived:
        It stood, and was at rest in the end.
    reason:
        How it ended, in words.
    time:
        Until when it stood [s].
    tilt:
        Largest angle of the trunk from its first vertical [rad].
    slip:
        How far a foot was from where it began, at most [m].
    relaxed:
        Share of the ticks in which something gave way, in [0, 1].
    """

    angle: float
    ratio: float
    impulse: float
    survived: bool
    reason: str
    time: float
    tilt: float
    slip: float
    relaxed: float

    @property
    def key(self) -> tuple[float, float]:
        """What tells pushes apart."""
        return key(self.angle, self.ratio)


class Trial(Protocol):
    """Tries a push; the outcome depends on nothing but the arguments."""

    def __call__(self, angle: float, ratio: float) -> PushOutcome:
        """Push at rest in a direction [rad], by an impulse in parts of M omega d."""


# Makes what tries pushes, once in every process: it is pickled, and need not be small.
MakeTrial = Callable[[], Trial]
Progress = Callable[[int, int, Mapping[str, Any]], None]


@dataclass(frozen=True, eq=False)
class PushGrid:
    """Directions evenly around times impulses.

    Attributes
    ----------
    directions:
        How many, the first along world x.
    ratios:
        Impulses (k,) in parts of M omega d, rising.
    failures:
        A direction ends after so many pushes in a row that were not survived; 0: never.

    Raises
    ------
    InvalidInputError
        No directions or ratios, or ratios that do not rise from above 0.
    """

    directions: int = 16
    ratios: ArrayLike = (0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0)
    failures: int = 2

    def __post_init__(self) -> None:
        for name, least in (("directions", 1), ("failures", 0)):
            value = whole_number(f"push grid, {name}", getattr(self, name), least=least)
            set_fields(self, **{name: value})
        given = real_array("push grid, ratios", self.ratios)
        ratios = finite_vector("push grid, ratios", given, given.size)
        if ratios.size == 0 or ratios[0] <= 0.0 or np.diff(ratios).min(initial=1.0) < 1e-6:
            raise InvalidInputError(f"push grid, ratios: must rise from above 0, got {ratios}")
        set_fields(self, ratios=read_only(ratios))

    @cached_property
    def angles(self) -> Array:
        """Of the directions (n,) [rad]."""
        return compass_angles(self.directions)

    @property
    def size(self) -> int:
        """How many pushes there are at most."""
        return self.directions * np.size(self.ratios)

    def next_ratio(self, angle: float, found: Mapping[tuple[float, float], PushOutcome]) -> float:
        """Return the next ratio to try in a direction; infinite if it is done."""
        in_a_row = 0
        for ratio in np.asarray(self.ratios).tolist():
            outcome = found.get(key(angle, ratio))
            if outcome is None:
                return float(ratio)
            in_a_row = 0 if outcome.survived else in_a_row + 1
            if self.failures and in_a_row == self.failures:
                break
        return math.inf

    def remaining(self, found: Mapping[tuple[float, float], PushOutcome]) -> int:
        """Return how many pushes are left at most, if all of them are survived."""
        ratios = np.asarray(self.ratios).tolist()
        return sum(
            key(angle, ratio) not in found
            for angle in self.angles.tolist()
            if math.isfinite(self.next_ratio(angle, found))
            for ratio in ratios
        )


def compass_angles(count: int) -> Array:
    """Return angles (count,) evenly around, from 0 on [rad]."""
    return 2.0 * np.pi * np.arange(count) / count


def key(angle: float, ratio: float) -> tuple[float, float]:
    """Return what tells pushes apart."""
    return round(angle, DIGITS), round(ratio, DIGITS)


def run_campaign(
    grid: PushGrid,
    make: MakeTrial,
    *,
    workers: int = 1,
    known: Iterable[PushOutcome] = (),
    record: Callable[[PushOutcome], object] | None = None,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> list[PushOutcome]:
    """Try the pushes of a grid, and return the outcomes by direction and impulse.

    Parameters
    ----------
    make:
        Called once in every process that tries pushes.
    workers:
        Processes that do; with 1 it is this one. More are started fresh (``spawn``), so a script
        needs the usual ``if __name__ == "__main__"`` guard. The outcomes do not depend on it.
    known:
        Outcomes from before; those of the grid are not tried again.
    record:
        Called here with every new outcome, as it comes.
    progress:
        Called with how many pushes are done, how many there will be at most, and a mapping: the
        last (``push``) and how many were tried now (``new``).
    cancelled:
        Asked between pushes; True ends the campaign with what there is.

    Raises
    ------
    WbcError
        What a trial raises; :class:`~wbc.workers.WorkerDiedError` if processes die of a push each
        time that it is tried.
    """
    size = int(finite_number("campaign, workers", workers, least=1.0))
    here = {key(a, r) for a in grid.angles.tolist() for r in np.asarray(grid.ratios).tolist()}
    found = {one.key: one for one in known if one.key in here}
    ended = cancelled or (lambda: False)
    tell = progress or (lambda done, total, info: None)
    if any(math.isfinite(grid.next_ratio(angle, found)) for angle in grid.angles.tolist()):
        outcomes = _one_by_one if size == 1 else _in_processes
        before = len(found)
        for outcome in outcomes(grid, make, found, min(size, grid.directions), ended):
            found[outcome.key] = outcome
            if record is not None:
                record(outcome)
            done = len(found)
            total = done + grid.remaining(found)
            tell(done, total, {"push": outcome, "new": done - before})
    return [found[one] for one in sorted(found)]


def _next(
    grid: PushGrid, found: Mapping[tuple[float, float], PushOutcome], busy: Iterable[float]
) -> tuple[float, float] | None:
    """Return the gentlest push to try, of a direction that is not being tried."""
    waits = [
        (grid.next_ratio(angle, found), angle)
        for angle in grid.angles.tolist()
        if angle not in set(busy)
    ]
    ratio, angle = min(waits, default=(math.inf, 0.0))
    return (angle, ratio) if math.isfinite(ratio) else None


def _one_by_one(
    grid: PushGrid,
    make: MakeTrial,
    found: Mapping[tuple[float, float], PushOutcome],
    _: int,
    ended: Callable[[], bool],
) -> Iterator[PushOutcome]:
    trial = make()
    while not ended() and (push := _next(grid, found, ())) is not None:
        yield trial(*push)


def _in_processes(
    grid: PushGrid,
    make: MakeTrial,
    found: Mapping[tuple[float, float], PushOutcome],
    size: int,
    ended: Callable[[], bool],
) -> Iterator[PushOutcome]:
    """Yield outcomes as they come; a direction is tried by one process at a time."""
    busy: set[tuple[float, float]] = set()
    with Workers(make, size) as workers:
        while not ended():
            angles = [angle for angle, _ in busy]
            while workers.room and (push := _next(grid, found, angles)):
                busy.add(push)
                angles.append(push[0])
                workers.submit(push, *push)
            if not busy:
                return
            for answer in workers.results(MOMENT):
                if answer.error is not None:
                    raise answer.error
                busy.discard(answer.key)
                yield answer.value


class CampaignLog(Journal):
    """What was pushed and how, then one outcome in each line; a context.

    Attributes
    ----------
    known:
        Outcomes that were there, by the name of the problem.

    Raises
    ------
    InvalidInputError, JournalError
        As :class:`~wbc.journal.Journal` does.
    """

    def __init__(self, path: Path, made_of: Mapping[str, Any]) -> None:
        super().__init__(path, made_of)
        self.known: dict[str, list[PushOutcome]] = {}
        try:
            for entry in self.entries:
                outcome = {name: value for name, value in entry.items() if name != "problem"}
                self.known.setdefault(entry["problem"], []).append(PushOutcome(**outcome))
        except (TypeError, KeyError) as error:
            self._file.close()
            raise not_ours(path, error) from error

    def record(self, problem: str, outcome: PushOutcome) -> None:
        """Keep an outcome."""
        self.add({"problem": problem, **outcome._asdict()})
