"""Results of a global search: candidates, rejected starts, statistics, and the motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from wbc.errors import WbcError
from wbc.validate import Array


class NoPostureError(WbcError):
    """No search found a posture that meets every constraint; the message says why."""


@dataclass(frozen=True, eq=False)
class ConstraintMargins:
    """How well a posture meets the constraints, computed with Pinocchio; None: there are none."""

    contact: float  # largest distance of a held frame from its anchor [m or rad]
    limit: float  # smallest distance to a joint limit, margin included [rad or m]; < 0: outside
    support: float | None  # distance of the CoM inside the support polygon, margin included [m]
    clearance: float | None  # least clearance of bodies, obstacles and boxes beyond the margin [m]
    broken: tuple[str, ...]  # descriptions of the violated constraints


@dataclass(frozen=True, eq=False)
class Candidate:
    """A posture that meets every constraint.

    Attributes
    ----------
    q:
        Configuration (nq,), read-only.
    cost:
        Sum of gain * 1/2 |weight * error|^2 over the tasks, from Pinocchio.
    errors:
        The tasks' errors, as they report them, by name.
    kept:
        How well the constraints are met.
    status, optimal, iterations:
        IPOPT's status, whether it found the optimality conditions to hold, and its iterations.
    starts:
        Numbers of the starts whose searches ended here; 0 is the current posture.
    """

    q: Array
    cost: float
    errors: Mapping[str, Array]
    kept: ConstraintMargins
    status: str
    optimal: bool
    iterations: int
    starts: tuple[int, ...]


@dataclass(frozen=True)
class Rejected:
    """A start whose search found no usable posture."""

    start: int | None  # its number; None for a sample from which no search was made
    reason: str
    kind: str  # the reason without numbers, so that rejections of a kind can be counted


class Stopped(StrEnum):
    """Why a search ended early: every task met, nothing better for long, out of time, or Ctrl-C."""

    MET = "met"
    SETTLED = "settled"
    SECONDS = "seconds"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class ShapingStatistics:
    """Counts and times of a search."""

    drawn: int  # samples
    searched: int  # starts
    iterations: int  # of IPOPT, in total
    build_seconds: float  # wall time of building the nonlinear program and the starts
    search_seconds: float
    workers: int  # processes that searched
    stopped: Stopped | None  # why the search ended before all starts were tried


@dataclass(frozen=True, eq=False)
class ShapingOutcome:
    """All distinct postures that a search found.

    Attributes
    ----------
    candidates:
        The best first; postures that agree within a tolerance are merged.
    rejected:
        Starts without a usable posture, and why.
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
            # Starts first, then samples from which no search was made, as far as there is room.
            reasons = dict.fromkeys(rejected.reason for rejected in self.rejected)
            raise NoPostureError(
                f"global shaping: none of {self.statistics.searched} starts led to a posture that"
                f" keeps every constraint; give more starts or seconds, or ask for less:"
                f" {'; '.join(list(reasons)[:3])}"
            )
        return self.candidates[0]


@dataclass(frozen=True)
class Attempt:
    """A controller's attempt to reach a candidate."""

    candidate: int  # its index in the outcome
    cost: float  # at the end of the motion
    reason: str  # why it does not count as reached, or "arrived"


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
        The candidate that it was meant to reach.
    kept:
        The worst value of every constraint over the motion, contacts [m or rad] as held by
        feedback.
    arrived:
        True if it meets every constraint and ends at the candidate's cost.
    at_rest:
        True if the robot was at rest at its end.
    attempts:
        All attempts up to this one.
    """

    time: Array
    q: Array
    v: Array
    cost: Array
    candidate: Candidate
    kept: ConstraintMargins
    arrived: bool
    at_rest: bool
    attempts: tuple[Attempt, ...]
