"""Is a solver slower than it was? Two files of figures, and a verdict on each solver.

Machines drift: the same code is a fifth faster or slower an hour later. Each pass is therefore
measured in units of a fixed computation just before and after it. The remaining scatter shows
between passes: a change counts only if a t interval of its logarithm lies wholly beyond
:data:`LEAST`. A solver that solves less is worse whatever its time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from scipy.special import stdtrit

from wbc.validate import Array

LEAST = 1.05  # smaller factors are ignored
CONFIDENCE = 0.999  # one-sided, of the interval
PASSES = 3  # fewer passes tell nothing about the scatter


class SpeedVerdict(StrEnum):
    """The result of comparing a solver."""

    FASTER = "faster"
    SLOWER = "slower"
    SAME = "same within noise"
    FAILS_MORE = "fails more"
    FAILS_LESS = "fails less"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class SpeedChange:
    """A solver then and now, on the sequences that both files have."""

    eps: str
    solver: str
    verdict: SpeedVerdict
    # ratio, low and high: time now over time then, and the interval that it lies in; NaN if that
    # is not known.
    ratio: float
    low: float
    high: float
    success: tuple[float, float]  # share of QPs solved, then and now
    reason: str = ""  # why nothing is known, in words; else empty


def compare(old: Mapping[str, Any], new: Mapping[str, Any]) -> tuple[list[SpeedChange], list[str]]:
    """Return the changes from one summary to another, and what could not be compared, in words."""
    common, notes = [], []
    if old["machine"] != new["machine"]:
        notes.append(f"measured on another machine: {old['machine']}, now {new['machine']}")
    for name, now in new["sequences"].items():
        then = old["sequences"].get(name)
        if then is None:
            notes.append(f"sequence {name!r} is new")
        elif then["digest"] != now["digest"]:
            notes.append(f"sequence {name!r} has other QPs now, and is left out")
        else:
            common.append(name)
    notes += [
        f"sequence {name!r} is gone" for name in old["sequences"] if name not in new["sequences"]
    ]
    changes = []
    for eps, at in new["accuracies"].items():
        before = old["accuracies"].get(eps, {"solvers": {}})["solvers"]
        for solver, now in at["solvers"].items():
            if solver in before and common:
                changes.append(_change(eps, solver, common, before[solver], now))
            else:
                notes.append(f"solver {solver!r} at {eps} is new or has no sequence in common")
    return changes, notes


def _change(
    eps: str, solver: str, common: list[str], old: Mapping[str, Any], new: Mapping[str, Any]
) -> SpeedChange:
    then, now = ([one["sequences"][name] for name in common] for one in (old, new))
    success = (_success(then), _success(now))
    before, after = _logs(then), _logs(now)
    if min(before.size, after.size) < PASSES:
        nan = float("nan")
        reason = f"needs {PASSES} passes each, has {before.size} and {after.size}"
        return SpeedChange(eps, solver, SpeedVerdict.UNKNOWN, nan, nan, nan, success, reason)
    found = time_ratio(before, after)
    verdict = found.verdict
    if success[1] != success[0]:
        verdict = SpeedVerdict.FAILS_MORE if success[1] < success[0] else SpeedVerdict.FAILS_LESS
    return SpeedChange(eps, solver, verdict, found.ratio, found.low, found.high, success)


class TimeRatio(NamedTuple):
    """New time over old time, its interval, and the verdict."""

    ratio: float
    low: float
    high: float
    verdict: SpeedVerdict


def time_ratio(before: Array, after: Array) -> TimeRatio:
    """Compare passes (r,), each the logarithm of a time in units of the fixed computation's."""
    middle = float(after.mean() - before.mean())
    scatter = before.var(ddof=1) / before.size + after.var(ddof=1) / after.size
    wide = float(stdtrit(before.size + after.size - 2, CONFIDENCE)) * math.sqrt(scatter)
    low, high = middle - wide, middle + wide
    verdict = SpeedVerdict.SAME
    if low > math.log(LEAST):
        verdict = SpeedVerdict.SLOWER
    elif high < -math.log(LEAST):
        verdict = SpeedVerdict.FASTER
    return TimeRatio(math.exp(middle), math.exp(low), math.exp(high), verdict)


def _success(figures: list[Mapping[str, Any]]) -> float:
    solved = sum(round(one["success"] * one["QPs"]) for one in figures)
    return float(solved / sum(one["QPs"] for one in figures))


def _logs(figures: list[Mapping[str, Any]]) -> Array:
    """Return, for each pass (r,), the mean over sequences of log(median / fixed computation)."""
    return np.mean(
        [np.log(np.divide(one["passes"], one["reference"])) for one in figures], axis=0
    )  # fmt: skip
