"""Operators of a loop: a person at the keyboard, or a script."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from enum import StrEnum
from io import TextIOWrapper
from queue import Empty, SimpleQueue
from typing import NamedTuple, Protocol

from wbc.hardware.safety import Mode


class Wish(StrEnum):
    """What an operator can request."""

    ARM = "arm"
    STAND = "stand"
    RUN = "run"
    SIT = "sit"  # come to rest, then go down
    STOP = "stop"
    RESET = "reset"
    QUIT = "quit"


class LoopStatus(NamedTuple):
    """The state of a loop, for its operator."""

    mode: Mode
    time: float  # since the loop began [s]
    mode_time: float  # since the mode began [s]
    hears: bool  # whether readings arrive
    is_up: bool  # whether the robot stands on its feet, and there is an estimate


class Operator(Protocol):
    """Called once in each cycle."""

    def wish(self, status: LoopStatus) -> Wish | None:
        """Return the present request, if any."""


class Keyboard:
    """Reads words from a terminal, in a thread: ``arm``, ``stand``, ``run``, ``sit``, ``stop``, ...

    An empty line stops at once: Enter is quickest.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._wishes: SimpleQueue[Wish] = SimpleQueue()
        self._say = say
        threading.Thread(target=self._listen, name="keyboard", daemon=True).start()

    def ask(self, wish: Wish) -> None:
        """Queue a request, as if it were typed."""
        self._wishes.put(wish)

    def wish(self, status: LoopStatus) -> Wish | None:
        """Return the next word."""
        try:
            return self._wishes.get_nowait()
        except Empty:
            return None

    def _listen(self) -> None:
        with suppress(OSError):  # the terminal is gone: on Linux an error, not an end of file
            for line in _typed_lines():
                self._hear(line.strip().lower())
        self._wishes.put(Wish.SIT)
        self._say("nothing more can be typed: the robot sits down; Ctrl-C or SIGTERM ends the loop")

    def _hear(self, word: str) -> None:
        if not word:
            self._wishes.put(Wish.STOP)
        elif word in list(Wish):
            self._wishes.put(Wish(word))
        else:
            self._say(f"not understood: {word}; one of: {', '.join(Wish)}")


def _typed_lines() -> Iterable[str]:
    """Return the lines of stdin as they are typed; invalid bytes are replaced.

    A thread that waits in ``sys.stdin`` holds its lock, and a process that is forked meanwhile
    waits for that lock before it begins: the controller would never answer. So this reads the
    same descriptor through a file object of its own.
    """
    if not isinstance(sys.stdin, TextIOWrapper):
        return sys.stdin or ()
    try:
        return open(sys.stdin.fileno(), errors="replace", closefd=False)
    except OSError:  # no descriptor
        sys.stdin.reconfigure(errors="replace")
        return sys.stdin


class Script:
    """Arms, stands up, runs for some time, sits down and ends, unattended: for simulators.

    Parameters
    ----------
    seconds:
        How long the controller runs [s].
    settle:
        How long it brakes before standing up, and before quitting [s].
    """

    def __init__(self, seconds: float, settle: float = 0.5) -> None:
        self._seconds, self._settle = seconds, settle
        self._was_up = False
        self._override: Wish | None = None

    def ask(self, wish: Wish) -> None:
        """Request something else now."""
        self._override = wish

    def wish(self, status: LoopStatus) -> Wish | None:
        """Return the next step when it is time."""
        if self._override is not None:
            override, self._override = self._override, None
            return override
        mode, mode_time = status.mode, status.mode_time
        if mode is Mode.IDLE and status.hears and not self._was_up:
            return Wish.ARM
        if mode is Mode.DAMPING and mode_time > self._settle:
            return Wish.QUIT if self._was_up else Wish.STAND
        if mode is Mode.STANDING_UP:
            self._was_up = True  # or on its way up
            return Wish.RUN if status.is_up else None
        if mode is Mode.RUNNING and mode_time > self._seconds:
            return Wish.SIT
        return Wish.QUIT if mode is Mode.STOP and mode_time > self._settle else None
