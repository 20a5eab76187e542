"""The report of a search over postures, as plain data: a part of the result of its run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from wbc.tasks import InertiaTask, PrincipalInertiaTask
from wbc.validate import Array


@dataclass(frozen=True, eq=False)
class Posture:
    """A posture that satisfies every constraint."""

    q: Array  # (nq,)
    cost: float  # sum over the tasks of gain * 1/2 |weight * error|^2
    relative_errors: Mapping[str, float]  # |actual - target| / |target| of each inertia task
    # IPOPT's own status, and whether it says that the conditions of optimality hold.
    status: str
    optimal: bool
    starts: tuple[int, ...]  # numbers of the starts that converged here; 0: the run's start
    tried: str | None  # result of moving there: "arrived", or why not; None if not tried


@dataclass(frozen=True)
class SearchEffort:
    """The effort of the search."""

    starts: int  # requested searches
    drawn: int  # samples drawn
    searched: int  # searches made
    iterations: int  # of IPOPT, in total
    # Wall times of building the program and the starts, of searching, and of moving.
    build_seconds: float
    search_seconds: float
    reach_seconds: float
    workers: int  # processes that searched
    # Why it ended before all starts: met (the tasks are met), settled (no better posture for long),
    # seconds or interrupted; or None.
    stopped: str | None


@dataclass(frozen=True, eq=False)
class ShapingReport:
    """The postures of a search, and how near the motion came to the best."""

    postures: tuple[Posture, ...]  # every distinct one, the best first
    rejected: Mapping[str, int]  # number of rejected starts and samples, by reason
    # Cost where the motion begins and ends.
    cost_start: float
    cost_end: float
    # |actual - target| / |target| of each inertia task there.
    relative_start: Mapping[str, float]
    relative_end: Mapping[str, float]
    led_to: int  # index of the posture that the motion went to
    arrived: bool  # whether it satisfies every constraint and ends at that posture's cost
    effort: SearchEffort

    @property
    def best(self) -> Posture:
        """The best posture, whether it was reached or not."""
        return self.postures[0]

    @property
    def above_best(self) -> float:
        """Relative excess of the final cost over the best posture's; NaN if that is 0."""
        best = self.best.cost
        return self.cost_end / best - 1.0 if best > 0.0 else float("nan")

    def describe(self) -> str:
        """Return in words which posture was reached, and why not the better ones."""
        count = len(self.postures)
        failures = [
            f"{number} {posture.tried}"
            for number, posture in enumerate(self.postures, 1)
            if posture.tried is not None and (number != self.led_to + 1 or not self.arrived)
        ]
        reasons = f" ({'; '.join(failures)})" if failures else ""
        if not self.arrived:
            return f"none of the postures was reached{reasons}"
        rank = "the best" if self.led_to == 0 else f"number {self.led_to + 1}"
        return f"reached {rank} of {count} posture{'s' if count > 1 else ''}{reasons}"

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
                    "cost": posture.cost,
                    "relative_error": dict(posture.relative_errors),
                    "status": posture.status,
                    "optimal": posture.optimal,
                    "starts": list(posture.starts),
                    "tried": posture.tried,
                    "q": posture.q.tolist(),
                }
                for rank, posture in enumerate(self.postures, 1)
            ],
            "rejected": dict(self.rejected),
            "effort": asdict(self.effort),
        }


def relative_error(task: InertiaTask | PrincipalInertiaTask, error: Array) -> float:
    """Return |actual - target| / |target|, Frobenius norms over the controlled entries.

    Infinite for a target of zero.

    ``error``: error (k,) that the task reports.
    """
    if isinstance(task, PrincipalInertiaTask):
        target = task.selection[0, 0] * task.target
    else:
        target = task.selection @ task.target
    norm = float(np.linalg.norm(target))
    return float(np.linalg.norm(error)) / norm if norm > 0.0 else float("inf")
