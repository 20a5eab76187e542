"""What ``wbc run`` shows while it runs: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

if TYPE_CHECKING:
    from wbc.problem import Progress as ProgressCall

SECONDS_BETWEEN_LINES = 5.0
SEARCHING = "searching"


@contextmanager
def shown_progress() -> Iterator[ProgressCall]:
    """Give what to call while the run goes on; it writes to stderr."""
    console = Console(stderr=True, highlight=False)
    if console.is_terminal:
        with _bar(console) as call:
            yield call
    else:
        yield _lines(console)


@contextmanager
def _bar(console: Console) -> Iterator[ProgressCall]:
    columns = (
        TextColumn("{task.fields[doing]}"),
        BarColumn(),
        TextColumn("{task.fields[state]}"),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        shown = bar.add_task("", total=None, doing="running", state="")

        def call(done: int, total: int, info: Mapping[str, Any]) -> None:
            doing, state = _doing(info), _state(info)
            if doing == SEARCHING:
                state = f"{done} of {total} starts, {state}"
            bar.update(shown, completed=done, total=total, doing=doing, state=state)

        yield call


def _lines(console: Console) -> ProgressCall:
    last = time.monotonic()

    def call(done: int, total: int, info: Mapping[str, Any]) -> None:
        nonlocal last
        if time.monotonic() - last > SECONDS_BETWEEN_LINES:
            last = time.monotonic()
            what = "start" if _doing(info) == SEARCHING else "tick"
            console.print(f"{what} {done} of at most {total}: {_state(info)}")

    return call


def _doing(info: Mapping[str, Any]) -> str:
    if "cost" in info:
        return SEARCHING
    return f"moving to posture {info['posture']}" if "posture" in info else "running"


def _state(info: Mapping[str, Any]) -> str:
    if "cost" in info:
        cost = info["cost"]
        return "no posture yet" if cost is None else f"best cost {cost:.4g}"
    speed = f", speed {info['speed']:.1e}" if "speed" in info else ""
    failed = f", {info['failed']} failed" if info.get("failed") else ""
    return f"t = {info['time']:.2f} s{speed}{failed}"
