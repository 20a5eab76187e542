"""Push campaigns: increasing pushes from all sides, in parallel processes.

A grid in place of a bisection, as a robot may survive a push and fall at a smaller one, which is
worth knowing. The pushes that are tried depend on the outcomes, not on the workers. Each outcome is
appended to a file as it comes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Protocol, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.journal import Journal, wrong_file_error
from wbc.kinds import whole_number
from wbc.validate import Array, finite_vector, read_only, real_array, set_fields
from wbc.workers import Workers

POLL_TIME = 0.1  # s to wait for an outcome before asking whether the campaign is cancelled
DIGITS = 9  # of angles and ratios in a push's key


class PushOutcome(NamedTuple):
    """The outcome of one push.

    Attributes
    ----------
    angle:
        Direction in the horizontal plane [rad]: 0 is along world x.
    ratio:
        Impulse by M omega d of this direction.
    impulse:
        [N s].
    survived:
        Whether the robot stood, and was at rest in the end.
    reason:
        How it ended, in words.
    time:
        Time until which it stood [s].
    tilt:
        Largest angle of the trunk from its initial vertical [rad].
    slip:
        Largest distance of a foot from its initial place [m].
    relaxed:
        Share of relaxed ticks, in [0, 1].
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
        """Key of the push; see :func:`key`."""
        return key(self.angle, self.ratio)


class Trial(Protocol):
    """Tries a push; the outcome depends on the arguments only."""

    def __call__(self, angle: float, ratio: float) -> PushOutcome:
        """Push the robot at rest in a direction [rad], by an impulse in units of M omega d."""


# Makes a trial, once in every process; it is pickled.
MakeTrial = Callable[[], Trial]
Progress = Callable[[int, int, Mapping[str, Any]], None]


@dataclass(frozen=True, eq=False)
class PushGrid:
    """Evenly spaced directions by impulses.

    Attributes
    ----------
    directions:
        Their number, the first along world x.
    ratios:
        Impulses (k,) in units of M omega d, increasing.
    failures:
        Number of failures in a row after which a direction ends; 0: never.

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

    @cached_property
    def keys(self) -> frozenset[tuple[float, float]]:
        """Of its pushes; see :func:`key`."""
        ratios = np.asarray(self.ratios).tolist()
        return frozenset(key(angle, ratio) for angle in self.angles.tolist() for ratio in ratios)

    @property
    def size(self) -> int:
        """Largest number of pushes."""
        return len(self.keys)

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
        """Return the number of pushes that remain if all of them are survived."""
        ratios = np.asarray(self.ratios).tolist()
        return sum(
            key(angle, ratio) not in found
            for angle in self.angles.tolist()
            if math.isfinite(self.next_ratio(angle, found))
            for ratio in ratios
        )


def compass_angles(count: int) -> Array:
    """Return evenly spaced angles (count,) from 0 on [rad]."""
    return 2.0 * np.pi * np.arange(count) / count


def key(angle: float, ratio: float) -> tuple[float, float]:
    """Return the key that identifies a push."""
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
        Number of these processes; 1: this one. More are started by ``spawn``, so a script needs
        the usual ``if __name__ == "__main__"`` guard. The outcomes do not depend on it.
    known:
        Earlier outcomes; those of the grid are not tried again.
    record:
        Called in this process with every new outcome, as it comes.
    progress:
        Called with the number of pushes done, their largest total, and a mapping: the last
        (``push``) and the number of new ones (``new``).
    cancelled:
        Called between pushes; True ends the campaign with the outcomes so far.

    Raises
    ------
    WbcError
        An error of a trial; :class:`~wbc.workers.WorkerDiedError` if processes die of a push each
        time that it is tried.
    """
    size = whole_number("campaign, workers", workers, least=1)
    found = {push.key: push for push in known if push.key in grid.keys}
    is_cancelled = cancelled or (lambda: False)
    report = progress or (lambda done, total, info: None)
    if any(math.isfinite(grid.next_ratio(angle, found)) for angle in grid.angles.tolist()):
        run = _run_serially if size == 1 else _run_in_processes
        before = len(found)
        for outcome in run(grid, make, found, min(size, grid.directions), is_cancelled):
            found[outcome.key] = outcome
            if record is not None:
                record(outcome)
            done = len(found)
            report(done, done + grid.remaining(found), {"push": outcome, "new": done - before})
    return [found[push] for push in sorted(found)]


def _next_push(
    grid: PushGrid, found: Mapping[tuple[float, float], PushOutcome], busy: Collection[float]
) -> tuple[float, float] | None:
    """Return the smallest push to try, of a direction that is not busy."""
    candidates = [
        (grid.next_ratio(angle, found), angle)
        for angle in grid.angles.tolist()
        if angle not in busy
    ]
    ratio, angle = min(candidates, default=(math.inf, 0.0))
    return (angle, ratio) if math.isfinite(ratio) else None


def _run_serially(
    grid: PushGrid,
    make: MakeTrial,
    found: Mapping[tuple[float, float], PushOutcome],
    _: int,
    is_cancelled: Callable[[], bool],
) -> Iterator[PushOutcome]:
    trial = make()
    while not is_cancelled() and (push := _next_push(grid, found, ())) is not None:
        yield trial(*push)


def _run_in_processes(
    grid: PushGrid,
    make: MakeTrial,
    found: Mapping[tuple[float, float], PushOutcome],
    size: int,
    is_cancelled: Callable[[], bool],
) -> Iterator[PushOutcome]:
    """Yield outcomes as they come; a direction is tried by one process at a time."""
    busy: set[tuple[float, float]] = set()
    with Workers(make, size) as workers:
        while not is_cancelled():
            angles = [angle for angle, _ in busy]
            while workers.room and (push := _next_push(grid, found, angles)):
                busy.add(push)
                angles.append(push[0])
                workers.submit(push, *push)
            if not busy:
                return
            for answer in workers.results(POLL_TIME):
                if answer.error is not None:
                    raise answer.error
                busy.discard(answer.key)
                yield answer.value


def outcome_of(told: Mapping[str, Any]) -> PushOutcome:
    """Return the outcome of a JSON file. Raises TypeError: other names, or values of other kinds.

    Null is a number that is not finite: of physics that blew up.
    """
    values: dict[str, Any] = {name: math.nan if v is None else v for name, v in dict(told).items()}
    found = PushOutcome(**values)
    for name, kind in get_type_hints(PushOutcome).items():
        value = getattr(found, name)
        if not isinstance(value, float | int if kind is float else kind):
            raise TypeError(f"{name}: {value!r}")
    return found


class CampaignLog(Journal):
    """A file of a campaign: its description, then an outcome in each line; a context manager.

    ``known``: outcomes found in it, by the name of the problem.

    Raises InvalidInputError, JournalError: as :class:`~wbc.journal.Journal` does.
    """

    def __init__(self, path: Path, made_of: Mapping[str, Any]) -> None:
        super().__init__(path, made_of)
        self.known: dict[str, list[PushOutcome]] = {}
        try:
            for entry in self.entries:
                told = {name: value for name, value in entry.items() if name != "problem"}
                self.known.setdefault(entry["problem"], []).append(outcome_of(told))
        except (TypeError, KeyError) as error:
            self._file.close()
            raise wrong_file_error(path, error) from error

    def record(self, problem: str, outcome: PushOutcome) -> None:
        """Append an outcome."""
        self.add({"problem": problem, **outcome._asdict()})
