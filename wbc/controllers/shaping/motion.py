"""The motion to a posture, what was tried to get there, and each tick of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from wbc.controllers.closed_loop import LoopTick
from wbc.controllers.shaping.outcome import Candidate, Kept
from wbc.validate import Array


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


# Called after every tick with the attempt's number, which is the index of its candidate in the
# outcome, and the tick; on the way its errors are those of the tasks that lead.
Watch = Callable[[int, LoopTick], None]


@dataclass(frozen=True, eq=False)
class Motion:
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
