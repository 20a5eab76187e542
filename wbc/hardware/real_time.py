"""Cycles by the clock, and what the system grants of real time."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import NamedTuple

from wbc.errors import InvalidInputError
from wbc.validate import finite_number

ABSOLUTE = 1  # TIMER_ABSTIME
LOCK_NOW_AND_LATER = 3  # MCL_CURRENT | MCL_FUTURE
# s of each sleep that are waited for awake: a processor that slept wakes up later than it should.
AWAKE = 2e-4
SWITCH = 1e-4  # s after which Python's threads take turns; 5 ms is its default


_slower = 1.0


def slow_down(times: float) -> None:
    """Let the time of this process pass so many times slower: for machines that do not keep up.

    A loop and a simulated robot that are slowed down alike do what they would do at full speed, in
    slow motion; a real robot would not.
    """
    global _slower  # noqa: PLW0603 - there is one time
    _slower = finite_number("slow motion, times", times, least=1.0)


def now() -> float:
    """Return the time [s] by which loops and simulated robots go: monotonic, of the system."""
    return time.monotonic() / _slower


class _TimeSpec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


def sleep_until(deadline: float) -> None:
    """Sleep until a time of :func:`now` [s], by ``clock_nanosleep`` where there is one.

    A sleep to a deadline does not add up what the way to it took, as relative ones do; its last
    0.2 ms are waited for awake.
    """
    deadline *= _slower
    rings = deadline - AWAKE
    left = rings - time.monotonic()
    if left > 0.0 and sys.platform == "linux":
        whole = int(rings)
        spec = _TimeSpec(whole, int((rings - whole) * 1e9))
        while _libc().clock_nanosleep(time.CLOCK_MONOTONIC, ABSOLUTE, ctypes.byref(spec), None):
            pass  # woken by a signal: the deadline stays
    elif left > 0.0:
        time.sleep(left)
    while time.monotonic() < deadline:
        pass


@cache  # each has circular references, and no garbage is collected while a loop runs
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def ordinary_priority() -> None:
    """Give up what a process of real time was granted before it forked this one."""
    if hasattr(os, "sched_setscheduler"):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def leave_signals_to_the_loop() -> None:
    """Ignore what is sent to all of its processes: a terminal's Ctrl-C, or that it is gone; a stop.

    The loop decides what it means, and needs the others until it is down.
    """
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


class Beat(NamedTuple):
    """When a cycle began [s, by :func:`now`], how late, and how many were left out before."""

    time: float
    lateness: float
    missed: int


class CycleClock:
    """Gives the beginnings of cycles, at whole periods from the first on.

    Parameters
    ----------
    dt:
        Period [s].
    """

    def __init__(self, dt: float) -> None:
        self.dt = finite_number("clock, dt", dt, above=0.0)
        self._due = now()

    @property
    def due(self) -> float:
        """When the next cycle should begin."""
        return self._due

    def wait(self) -> Beat:
        """Sleep until the next cycle's time; return when it began.

        Cycles whose time is over altogether are left out, not caught up with.
        """
        sleep_until(self._due)
        began = now()
        late = began - self._due
        missed = int(late / self.dt)
        self._due += (missed + 1) * self.dt
        return Beat(began, late, missed)


def check_cpus(cpus: Sequence[int]) -> None:
    """Raise InvalidInputError for a CPU on which this process may not run; none is known: none."""
    if not hasattr(os, "sched_getaffinity"):
        return
    known = sorted(os.sched_getaffinity(0))
    for cpu in cpus:
        if cpu not in known:
            raise InvalidInputError(f"CPU {cpu}: this process may run on {known}")


def pin(cpu: int | None) -> None:
    """Let this process run on one CPU only, where that can be said; None: wherever."""
    if cpu is not None and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {cpu})


@contextmanager
def real_time(priority: int) -> Iterator[tuple[str, ...]]:
    """Run under ``SCHED_FIFO`` with locked memory and without garbage collection, where allowed.

    Yield what was not granted, in words. Threads that are started inside inherit the priority.

    Parameters
    ----------
    priority:
        From 1 to 99; 0 asks for nothing.
    """
    notes = list[str]()
    if priority and not hasattr(os, "sched_setscheduler"):
        notes.append("this system has no SCHED_FIFO: cycles may begin late")
    elif priority:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError as error:
            notes.append(
                f"SCHED_FIFO was refused ({error.strerror}): cycles may begin late; allow it by"
                " 'ulimit -r 90', or in /etc/security/limits.conf"
            )
        if sys.platform == "linux" and _libc().mlockall(LOCK_NOW_AND_LATER):
            notes.append("memory could not be locked: a page that was swapped out costs ms")
    switch = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH)
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield tuple(notes)
    finally:
        gc.enable()
        gc.unfreeze()
        sys.setswitchinterval(switch)
        if priority and hasattr(os, "sched_setscheduler"):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            if sys.platform == "linux":
                _libc().munlockall()
