"""What a search over postures came to, as plain data: a part of the result of its run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from wbc.tasks import InertiaTask, PrincipalInertiaTask
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Posture:
    """A posture that keeps every constraint."""

    q: Array  # (nq,)
    cost: float  # sum over the tasks of gain * 1/2 |weight * error|^2
    relative_errors: Mapping[str, float]  # |actual - target| / |target| of each inertia task
    # status and optimal: IPOPT's own word, and whether it says that the conditions of optimality
    # hold.
    status: str
    optimal: bool
    starts: tuple[int, ...]  # numbers of the starts that led here; 0 is the start of the run
    tried: str | None  # what came of moving there: "arrived", or why not; None if it was not tried


@dataclass(frozen=True)
class SearchEffort:
    """What the search took."""

    starts: int  # how many searches were asked for
    drawn: int  # samples drawn
    searched: int  # searches made
    iterations: int  # of IPOPT, in all
    # build_seconds, search_seconds and reach_seconds: wall time of making the program and the
    # starts, of searching, and of moving.
    build_seconds: float
    search_seconds: float
    reach_seconds: float
    workers: int  # processes that searched
    # Why it ended before all starts were tried: met (the tasks are met), settled (nothing better
    # was found for long), seconds or interrupted; or None.
    stopped: str | None


@dataclass(frozen=True, eq=False)
class ShapingReport:
    """What a search over postures came to, and how near the motion came to its best."""

    postures: tuple[Posture, ...]  # every distinct one found, the best first
    rejected: Mapping[str, int]  # how many starts and samples came to nothing, by reason
    # cost_start and cost_end: cost where the motion begins and ends.
    cost_start: float
    cost_end: float
    # relative_start and relative_end: |actual - target| / |target| of each inertia task there.
    relative_start: Mapping[str, float]
    relative_end: Mapping[str, float]
    led_to: int  # index of the posture that the motion was led to
    arrived: bool  # true if it keeps every constraint and ends at that posture's cost
    effort: SearchEffort

    @property
    def best(self) -> Posture:
        """The best posture, whether it was reached or not."""
        return self.postures[0]

    @property
    def above_best(self) -> float:
        """By which part of the best posture's cost the motion ends above it; NaN if that is 0."""
        best = self.best.cost
        return self.cost_end / best - 1.0 if best > 0.0 else float("nan")

    def describe(self) -> str:
        """Return in words whether a posture was reached, and if not the best, why not."""
        count = len(self.postures)
        failed = [
            f"{number} {posture.tried}"
            for number, posture in enumerate(self.postures, 1)
            if posture.tried is not None and (number != self.led_to + 1 or not self.arrived)
        ]
        why = f" ({'; '.join(failed)})" if failed else ""
        if not self.arrived:
            return f"none of the postures was reached{why}"
        which = "the best" if self.led_to == 0 else f"number {self.led_to + 1}"
        return f"reached {which} of {count} posture{'s' if count > 1 else ''}{why}"

    def summary(self) -> dict[str, Any]:
        """Return everything as plain data."""
        return {
            "arrived": self.arrived,
            "led_to": self.led_to + 1,
            "cost": {
                "start": self.cost_start,
                "best_posture": self.best.cost,
                "reached": self.cost_end,
            },
            "relative_error": {
                "start": dict(self.relative_start),
                "best_posture": dict(self.best.relative_errors),
                "reached": dict(self.relative_end),
            },
            "postures": [
                {
                    "rank": rank,
                    "cost": one.cost,
                    "relative_error": dict(one.relative_errors),
                    "status": one.status,
                    "optimal": one.optimal,
                    "starts": list(one.starts),
                    "tried": one.tried,
                    "q": one.q.tolist(),
                }
                for rank, one in enumerate(self.postures, 1)
            ],
            "rejected": dict(self.rejected),
            "effort": asdict(self.effort),
        }


def relative_error(task: InertiaTask | PrincipalInertiaTask, error: Array) -> float:
    """Return |actual - target| / |target|, Frobenius over what the task controls.

    Infinite for a target of zero.

    Parameters
    ----------
    error:
        What the task reports as its error (k,).
    """
    if isinstance(task, PrincipalInertiaTask):
        wanted = task.selection[0, 0] * task.target
    else:
        wanted = task.selection @ task.target
    size = float(np.linalg.norm(wanted))
    return float(np.linalg.norm(error)) / size if size > 0.0 else float("inf")
