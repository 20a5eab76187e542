"""When a run ends, when it is at rest, and what its end is called."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from wbc.validate import by_name, check_fields, finite_number

REST_TICKS = 10


@dataclass(frozen=True)
class Stop:
    """When a run ends, and what must hold then.

    Attributes
    ----------
    duration:
        Longest time to run [s].
    speed:
        The robot is at rest, and the run over, when no velocity is above this [rad/s, m/s] for ten
        ticks in a row; None: always run for the whole duration.
    accept:
        Tolerance on the norm of a task's error at the end, by the task's name.
    balance:
        How far inside the polygon of the soles that stand the CoM's projection stays all the time
        [m]; None: no matter where.
    slip:
        Farthest that a held frame may be from its anchor [m], unless it may give way; None: any.
    margins:
        By how much joint limits and constraints may be exceeded [m or rad], from when they are
        first kept in a phase, unless they may give way; None: by anything.

    Raises
    ------
    InvalidInputError
        One of these is no finite number, or the duration is negative.
    """

    duration: float = 20.0
    speed: float | None = 1e-5
    accept: Mapping[str, float] = field(default_factory=dict)
    balance: float | None = 0.0
    slip: float | None = 5e-3
    margins: float | None = 1e-4

    def __post_init__(self) -> None:
        check_fields(self, "stop, ", "duration", least=0.0)
        optional = ("speed", "balance", "slip", "margins")
        check_fields(self, "stop, ", *(name for name in optional if vars(self)[name] is not None))
        for name, norm in by_name("stop, accept", self.accept).items():
            finite_number(f"stop, accept, {name}", norm, least=0.0)


class RunStatus(StrEnum):
    """How a run ended.

    ``CONVERGED``: at rest, and every tolerance met. ``ACCEPTED``: every tolerance met, though not
    at rest, when the time was over. ``COMPLETED``: the whole duration was asked for (``speed:
    null``) and no tolerance given. ``TIMEOUT``: not at rest when the time was over.
    ``NOT_REACHED``: a tolerance was not met. ``NOT_KEPT``: balance, a contact or a margin was not
    kept all the time, as :class:`Stop` asks; the robot may fall or collide. ``QP_FAILED``: a tick
    had no solution. ``NOT_STANDING``: a phase could not begin, because a foot that it stands on
    was in the air or tilted; the run ended there. ``INTERRUPTED``: it was asked to end early.
    """

    CONVERGED = "converged"
    ACCEPTED = "accepted"
    COMPLETED = "completed"
    TIMEOUT = "timeout"
    NOT_REACHED = "not_reached"
    NOT_KEPT = "not_kept"
    QP_FAILED = "qp_failed"
    NOT_STANDING = "not_standing"
    INTERRUPTED = "interrupted"

    @property
    def good(self) -> bool:
        """True if the run did what was asked."""
        return self in (RunStatus.CONVERGED, RunStatus.ACCEPTED, RunStatus.COMPLETED)


class RestWatch:
    """Tells when nothing has moved for ten solved ticks in a row, all ramps being over."""

    def __init__(self, speed: float | None, ramps_over: float) -> None:
        self._speed = speed
        self._ramps_over = ramps_over
        self._still = 0

    def at_rest(self, time: float, fastest: float, solved: bool) -> bool:
        """Take note of a tick; ``fastest`` is the largest absolute velocity it commands."""
        slow = self._speed is not None and fastest < self._speed
        # A tick without solution commands zero: that is no rest.
        self._still = self._still + 1 if slow and solved and time >= self._ramps_over else 0
        return self._still >= REST_TICKS


def ending(
    stop: Stop,
    at_rest: bool,
    failed: int,
    ticks: int,
    norms: Mapping[str, float],
    broken_off: str | None = None,
    not_kept: Sequence[str] = (),
    interrupted: float | None = None,
) -> tuple[RunStatus, str]:
    """Return how a run ended, and why, in words.

    Parameters
    ----------
    failed, ticks:
        How many ticks had no solution, of how many.
    norms:
        Norm of each task's error at the end.
    broken_off:
        Why a phase could not begin, or None.
    not_kept:
        What was to be kept all the time and was not, in words.
    interrupted:
        When the run was asked to end [s], if that is why it did.
    """
    if failed:
        return RunStatus.QP_FAILED, f"{failed} of {ticks} ticks had no solution"
    if broken_off is not None:
        return RunStatus.NOT_STANDING, broken_off
    if interrupted is not None:
        also = f"; {'; '.join(not_kept)}" if not_kept else ""
        reason = f"at {interrupted:.4g} s of at most {stop.duration:g} s{also}"
        return RunStatus.INTERRUPTED, reason
    missed = [
        f"{name} (error {norms[name]:.3g}, tolerance {tolerance:g})"
        for name, tolerance in stop.accept.items()
        if not norms[name] <= tolerance
    ]
    how = "at rest" if at_rest else f"still moving after {stop.duration:g} s"
    if stop.speed is None:
        how = f"ran for {stop.duration:g} s"
    if not_kept:
        also = f"; not within tolerance: {', '.join(missed)}" if missed else ""
        return RunStatus.NOT_KEPT, f"{how}, but {'; '.join(not_kept)}{also}"
    if missed:
        return RunStatus.NOT_REACHED, f"{how}; not within tolerance: {', '.join(missed)}"
    within = "; every tolerance met" if stop.accept else ""
    if at_rest:
        return RunStatus.CONVERGED, how + within
    if stop.accept:
        return RunStatus.ACCEPTED, how + within
    status = RunStatus.COMPLETED if stop.speed is None else RunStatus.TIMEOUT
    return status, how
