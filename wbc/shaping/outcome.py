"""Results of a global search: candidates, rejected starts, statistics, and the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from wbc.errors import WbcError
from wbc.validate import Array


class NoPostureError(WbcError):
    """No search ended at a posture that keeps every constraint; the message says why."""


@dataclass(frozen=True, eq=False)
class Kept:
    """How well a posture keeps the constraints, measured by Pinocchio.

    Attributes
    ----------
    contact:
        Largest distance of a held frame from its anchor [m or rad]; 0 without contacts.
    limit:
        Smallest distance to a joint limit, margin included [rad or m]; negative outside.
    support:
        How far the CoM is inside the support polygon, margin included [m]; None if not asked for.
    clearance:
        How much more room than asked for bodies, obstacles and boxes leave, the least [m]; None
        without such constraints.
    broken:
        Constraints that are not kept, in words; empty if all are.
    """

    contact: float
    limit: float
    support: float | None
    clearance: float | None
    broken: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A posture that keeps every constraint.

    Attributes
    ----------
    q:
        Configuration (nq,), read-only.
    cost:
        Sum of gain * 1/2 |weight * error|^2 over the tasks, from Pinocchio.
    errors:
        What each task reports as its error, by name.
    kept:
        How well constraints are kept.
    status, optimal, iterations:
        IPOPT's own word, whether it says that the conditions of optimality hold, and its steps.
    starts:
        Numbers of the starts that led here; 0 is the current posture.
    """

    q: Array
    cost: float
    errors: Mapping[str, Array]
    kept: Kept
    status: str
    optimal: bool
    iterations: int
    starts: tuple[int, ...]


@dataclass(frozen=True)
class Rejected:
    """A start that led to no usable posture.

    Attributes
    ----------
    start:
        Its number; None for a sample that was never searched from.
    reason:
        Why, in words.
    kind:
        Why, in words without numbers, by which reasons can be counted.
    """

    start: int | None
    reason: str
    kind: str


class Stopped(StrEnum):
    """Why a search ended early: every task met, nothing better for long, out of time, or Ctrl-C."""

    MET = "met"
    SETTLED = "settled"
    SECONDS = "seconds"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class ShapingStatistics:
    """What the search did.

    Attributes
    ----------
    drawn, searched:
        Samples drawn, and starts searched from.
    iterations:
        Of IPOPT, in all.
    build_seconds, search_seconds:
        Wall time of making the program and the starts, and of searching.
    workers:
        Processes that searched.
    stopped:
        Why the search ended before all starts were tried, or None.
    """

    drawn: int
    searched: int
    iterations: int
    build_seconds: float
    search_seconds: float
    workers: int
    stopped: Stopped | None


@dataclass(frozen=True, eq=False)
class ShapingOutcome:
    """Every distinct posture that was found.

    Attributes
    ----------
    candidates:
        The best first; postures that are the same but for a tolerance are merged.
    rejected:
        What came to nothing, and why.
    statistics:
        Statistics of the search.
    """

    candidates: tuple[Candidate, ...]
    rejected: tuple[Rejected, ...]
    statistics: ShapingStatistics

    @property
    def best(self) -> Candidate:
        """The best posture.

        Raises
        ------
        NoPostureError
            There is none.
        """
        if not self.candidates:
            # Starts first; of samples that were not searched from only if there is room.
            reasons = dict.fromkeys(rejected.reason for rejected in self.rejected)
            raise NoPostureError(
                f"global shaping: none of {self.statistics.searched} starts led to a posture that"
                f" keeps every constraint; give more starts or seconds, or ask for less:"
                f" {'; '.join(list(reasons)[:3])}"
            )
        return self.candidates[0]


@dataclass(frozen=True)
class Attempt:
    """A candidate that the controller was led to.

    Attributes
    ----------
    candidate:
        Its index in the outcome.
    cost:
        Where the motion ended.
    reason:
        Why it does not count as reached, or ``"arrived"``.
    """

    candidate: int
    cost: float
    reason: str


@dataclass(frozen=True, eq=False)
class ShapingMotion:
    """A motion from the current posture, tick by tick.

    Attributes
    ----------
    time:
        (T,) [s].
    q:
        (T, nq); the first row is the current posture.
    v:
        (T, nv): ``q[k + 1] = integrate(q[k], v[k], dt)``; the last row is zero.
    cost:
        (T,) of the tasks.
    candidate:
        Where it was led to.
    kept:
        The worst of every constraint over the motion, contacts [m or rad] as held by feedback.
    arrived:
        True if it keeps every constraint and ends at the candidate's cost.
    at_rest:
        True if nothing moved any more when it ended.
    attempts:
        This one and those before it.
    """

    time: Array
    q: Array
    v: Array
    cost: Array
    candidate: Candidate
    kept: Kept
    arrived: bool
    at_rest: bool
    attempts: tuple[Attempt, ...]
