"""The progress of a long command: a bar on a terminal, elsewhere a line every few seconds.

Until there is progress, terminals show the present activity.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.status import Status
from rich.text import Text

from wbc.cli.console import plain_console

if TYPE_CHECKING:
    from wbc.batch import BatchProgress

SECONDS_BETWEEN_LINES = 5.0


class ProgressCall(Protocol):
    """Called by a job to report progress."""

    def __call__(self, done: int, total: int, info: Mapping[str, Any] | None = None) -> None:
        """Report ``done`` ticks or starts of a run (with ``info``), or frames of a motion."""


@contextmanager
def shown_progress(quiet: bool = False) -> Iterator[ProgressCall | None]:
    """Provide a progress function that writes to stderr; None if ``quiet``."""
    if quiet:
        yield None
        return
    console = plain_console(stderr=True)
    if not console.is_terminal:
        yield _lines(console)
        return
    told, state = (
        TextColumn(f"{{task.fields[{one}]}}", markup=False) for one in ("doing", "state")
    )
    columns = told, BarColumn(), state
    with Progress(*columns, console=console, transient=True) as bar:
        shown = bar.add_task("", total=None, doing="", state="")

        def call(done: int, total: int, info: Mapping[str, Any] | None = None) -> None:
            doing, unit, state = _labels_of(info)
            if unit != "tick":
                state = ", ".join((f"{done} of {total} {unit}s", *([state] if state else [])))
            bar.update(shown, completed=done, total=total, doing=doing, state=state)

        yield call


def _lines(console: Console) -> ProgressCall:
    last = time.monotonic()

    def call(done: int, total: int, info: Mapping[str, Any] | None = None) -> None:
        nonlocal last
        if time.monotonic() - last > SECONDS_BETWEEN_LINES:
            last = time.monotonic()
            _, unit, state = _labels_of(info)
            most = "" if unit in ("run", "pass") else "at most "
            console.print(
                f"{unit} {done} of {most}{total}: {state}" if state else f"{unit} {done} of {total}"
            )

    return call


def _labels_of(info: Mapping[str, Any] | None) -> tuple[str, str, str]:
    """Return the activity, its unit of progress, and a remark."""
    if info is None:
        return "analysing", "frame", ""
    if "drawing" in info:
        return "drawing", "frame", ""
    if "solver" in info:
        return "measuring", "pass", info["solver"]
    if "batch" in info:
        return "running", "run", batch_state(info["batch"], info["seconds"])
    if "push" in info:
        push = info["push"]
        ended = "survived" if push.survived else "not survived"
        last = f"{push.ratio:.4g} at {math.degrees(push.angle):.4g} deg {ended}"
        return "pushing", "push", last + push_state(info)
    if "cost" in info:
        cost = info["cost"]
        return "searching", "start", "no posture yet" if cost is None else f"best cost {cost:.4g}"
    doing = f"moving to posture {info['posture']}" if "posture" in info else "running"
    speed = f", speed {info['speed']:.1e}" if "speed" in info else ""
    bad = "".join(f", {info[one]} {one}" for one in ("failed", "relaxed") if info.get(one))
    return doing, "tick", f"t = {info['time']:.2f} s{speed}{bad}"


def push_state(info: Mapping[str, Any]) -> str:
    """Return the longest remaining time of a campaign of pushes, at the rate so far, in words."""
    if "left" not in info:
        return ""
    return f", at most {in_words(info['left'] * info['seconds'] / info['new'])} left"


def batch_state(at: BatchProgress, seconds: float) -> str:
    """Return rate and remaining time of a campaign that has run for a while [s], in words."""
    rate = at.new / max(seconds, 1e-9)
    left = (at.total - at.done) / rate if rate else math.inf
    speed = f"{rate:.3g} per s" if rate >= 1.0 else f"{1.0 / rate if rate else math.inf:.3g} s each"
    return f"{speed}, {in_words(left)} left"


def in_words(seconds: float) -> str:
    """Return a duration in a readable unit."""
    if not math.isfinite(seconds):
        return "unknown time"
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.0f} s"


DOING = "wbc.doing"  # the library's logger for slow activities


class _StatusHandler(logging.Handler):
    """Shows the last log message."""

    def __init__(self, status: Status) -> None:
        super().__init__(logging.INFO)
        self._status = status

    def emit(self, record: logging.LogRecord) -> None:
        self._status.update(Text(f"{record.getMessage()} ..."))


@contextmanager
def starting(what: str, quiet: bool = False) -> Iterator[None]:
    """Show the present activity on the terminal, if there is one.

    ``what``: the first activity, such as ``"loading p.yaml"``; the library logs later ones.
    """
    console, logger = plain_console(stderr=True), logging.getLogger(DOING)
    if quiet or not console.is_terminal:
        yield
        return
    level, propagates = logger.level, logger.propagate
    with console.status(Text(f"{what} ...")) as status:
        told = _StatusHandler(status)
        logger.setLevel(logging.INFO)
        logger.addHandler(told)
        logger.propagate = False
        try:
            yield
        finally:
            logger.removeHandler(told)
            logger.setLevel(level)
            logger.propagate = propagates
