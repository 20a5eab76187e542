"""Periodic cycles, and the system's real-time facilities."""

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

TIMER_ABSTIME = 1
MLOCK_ALL = 3  # MCL_CURRENT | MCL_FUTURE
# s of busy waiting at the end of each sleep: a sleeping processor wakes up late.
SPIN_TIME = 2e-4
THREAD_SWITCH_INTERVAL = 1e-4  # s between Python's threads; its default is 5 ms


_time_scale = 1.0


def slow_down(times: float) -> None:
    """Slow down the time of this process by a factor, for machines that do not keep up.

    A loop and a simulated robot with the same factor behave as at full speed; a real robot would
    not.
    """
    global _time_scale  # noqa: PLW0603 - one clock per process
    _time_scale = finite_number("slow motion, times", times, least=1.0)


def now() -> float:
    """Return the time [s] of loops and simulated robots: the system's monotonic clock, scaled."""
    return time.monotonic() / _time_scale


class _TimeSpec(ctypes.Structure):
    _fields_ = [("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long)]


def sleep_until(deadline: float) -> None:
    """Sleep until a time of :func:`now` [s], by ``clock_nanosleep`` where available.

    Unlike relative sleeps, absolute ones do not accumulate delays; the last 0.2 ms are a busy wait.
    """
    deadline *= _time_scale
    wake_up = deadline - SPIN_TIME
    left = wake_up - time.monotonic()
    if left > 0.0 and sys.platform == "linux":
        whole = int(wake_up)
        spec = _TimeSpec(whole, int((wake_up - whole) * 1e9))
        while _libc().clock_nanosleep(
            time.CLOCK_MONOTONIC, TIMER_ABSTIME, ctypes.byref(spec), None
        ):
            pass  # woken by a signal: the deadline stays
    elif left > 0.0:
        time.sleep(left)
    while time.monotonic() < deadline:
        pass


@cache  # it has circular references, and garbage collection is off in a loop
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def drop_real_time() -> None:
    """Give up the real-time priority, as one inherited from the process that forked this one."""
    if hasattr(os, "sched_setscheduler"):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def ignore_signals() -> None:
    """Ignore signals that go to all processes of a loop: Ctrl-C, a closed terminal, a stop.

    The loop handles them, and needs its other processes until the robot is down.
    """
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


class Beat(NamedTuple):
    """Beginning of a cycle [s, by :func:`now`], its lateness [s], and cycles skipped before it."""

    time: float
    lateness: float
    missed: int


class CycleClock:
    """Times cycles at whole periods from the first on.

    ``dt``: period [s].

    ``due``: planned beginning of the next cycle [s].
    """

    def __init__(self, dt: float) -> None:
        self.dt, self.due = finite_number("clock, dt", dt, above=0.0), now()

    def wait(self) -> Beat:
        """Sleep until the next cycle; return its beginning.

        Cycles whose whole period has passed are skipped, not caught up on.
        """
        sleep_until(self.due)
        start = now()
        lateness = start - self.due
        missed = int(lateness / self.dt)
        self.due += (missed + 1) * self.dt
        return Beat(start, lateness, missed)


def check_cpus(cpus: Sequence[int]) -> None:
    """Raise InvalidInputError for a CPU that this process may not run on, where that is known."""
    if not hasattr(os, "sched_getaffinity"):
        return
    allowed = sorted(os.sched_getaffinity(0))
    for cpu in cpus:
        if cpu not in allowed:
            raise InvalidInputError(f"CPU {cpu}: this process may run on {allowed}")


def pin(cpu: int | None) -> None:
    """Pin this process to one CPU, where supported; None: any."""
    if cpu is not None and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {cpu})


@contextmanager
def real_time(priority: int) -> Iterator[tuple[str, ...]]:
    """Run under ``SCHED_FIFO`` with locked memory and without garbage collection, where allowed.

    Yield what was not granted, in words. Threads started inside inherit the priority.

    ``priority``: from 1 to 99; 0: neither priority nor locked memory.
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
        if sys.platform == "linux" and _libc().mlockall(MLOCK_ALL):
            notes.append("memory could not be locked: a page that was swapped out costs ms")
    interval = sys.getswitchinterval()
    sys.setswitchinterval(THREAD_SWITCH_INTERVAL)
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield tuple(notes)
    finally:
        gc.enable()
        gc.unfreeze()
        sys.setswitchinterval(interval)
        if priority:
            drop_real_time()
            if sys.platform == "linux":
                _libc().munlockall()
