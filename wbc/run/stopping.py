"""When a run ends, when it is at rest, and its status."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from wbc.errors import UnknownNameError
from wbc.tasks import Task
from wbc.validate import by_name, check_fields, finite_number

REST_TICKS = 10


@dataclass(frozen=True)
class Stop:
    """Stop criteria of a run, and conditions on it.

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
        Distance that the CoM's projection must be inside the support polygon in every tick [m];
        None: anywhere.
    slip:
        Largest distance of a hard contact from its anchor [m]; None: any.
    margins:
        Largest violation of joint limits and hard constraints [m or rad], after they first hold in
        a phase; None: any.

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

    def check_tasks(self, tasks: Iterable[Task]) -> None:
        """Raise UnknownNameError if ``accept`` names a task that is none of these."""
        names = [task.name for task in tasks]
        for name in self.accept:
            if name not in names:
                raise UnknownNameError("task", name, names)


class RunStatus(StrEnum):
    """How a run ended.

    ``CONVERGED``: at rest, and every tolerance met. ``ACCEPTED``: every tolerance met, though not
    at rest, when the time was over. ``COMPLETED``: the whole duration was run as requested
    (``speed: null``) and no tolerance given. ``TIMEOUT``: not at rest when the time was over.
    ``NOT_REACHED``: a tolerance was not met. ``NOT_KEPT``: balance, a contact or a margin was
    violated in some tick (see :class:`Stop`); the robot may fall or collide. ``QP_FAILED``: a tick
    had no solution. ``NOT_STANDING``: a phase could not begin, because a foot that it stands on
    was in the air or tilted; the run ended there. ``INTERRUPTED``: it was cancelled.
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
        """Whether the run succeeded."""
        return self in (RunStatus.CONVERGED, RunStatus.ACCEPTED, RunStatus.COMPLETED)


class RestDetector:
    """Detects rest: ten solved ticks in a row at low speed, after the end of all ramps."""

    def __init__(self, speed: float | None, ramps_end: float) -> None:
        self._speed = speed
        self._ramps_end = ramps_end
        self._slow = 0

    def at_rest(self, time: float, speed: float, solved: bool) -> bool:
        """Return whether the robot is at rest; ``speed`` is the largest commanded velocity."""
        slow = self._speed is not None and speed < self._speed
        # A tick without solution commands zero, which is no rest.
        self._slow = self._slow + 1 if slow and solved and time >= self._ramps_end else 0
        return self._slow >= REST_TICKS


def run_status(
    stop: Stop,
    at_rest: bool,
    failed: int,
    ticks: int,
    norms: Mapping[str, float],
    aborted: str | None = None,
    not_kept: Sequence[str] = (),
    interrupted: float | None = None,
) -> tuple[RunStatus, str]:
    """Return the status of a run, and its reason in words.

    ``failed``, ``ticks``: number of ticks without solution, and of all.
    ``norms``: norm of each task's error at the end.
    ``aborted``: why a phase could not begin, or None.
    ``not_kept``: conditions that were violated in some tick, in words.
    ``interrupted``: time of the cancellation [s], if that ended the run.
    """
    if failed:
        return RunStatus.QP_FAILED, f"{failed} of {ticks} ticks had no solution"
    if aborted is not None:
        return RunStatus.NOT_STANDING, aborted
    if interrupted is not None:
        more = f"; {'; '.join(not_kept)}" if not_kept else ""
        reason = f"at {interrupted:.4g} s of at most {stop.duration:g} s{more}"
        return RunStatus.INTERRUPTED, reason
    missed = [
        f"{name} (error {norms[name]:.3g}, tolerance {tolerance:g})"
        for name, tolerance in stop.accept.items()
        if not norms[name] <= tolerance
    ]
    ending = "at rest" if at_rest else f"still moving after {stop.duration:g} s"
    if stop.speed is None:
        ending = f"ran for {stop.duration:g} s"
    if not_kept:
        more = f"; not within tolerance: {', '.join(missed)}" if missed else ""
        return RunStatus.NOT_KEPT, f"{ending}, but {'; '.join(not_kept)}{more}"
    if missed:
        return RunStatus.NOT_REACHED, f"{ending}; not within tolerance: {', '.join(missed)}"
    within = "; every tolerance met" if stop.accept else ""
    if at_rest:
        return RunStatus.CONVERGED, ending + within
    if stop.accept:
        return RunStatus.ACCEPTED, ending + within
    status = RunStatus.COMPLETED if stop.speed is None else RunStatus.TIMEOUT
    return status, ending
