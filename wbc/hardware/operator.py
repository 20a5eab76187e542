"""Who says when: a person at the keyboard, or a script."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from enum import StrEnum
from io import TextIOWrapper
from queue import Empty, SimpleQueue
from typing import NamedTuple, Protocol

from wbc.hardware.safety import Mode


class Wish(StrEnum):
    """What can be asked of a loop."""

    ARM = "arm"
    STAND = "stand"
    RUN = "run"
    SIT = "sit"  # come to rest, then go down
    STOP = "stop"
    RESET = "reset"
    QUIT = "quit"


class LoopStatus(NamedTuple):
    """What who wishes should know."""

    mode: Mode
    time: float  # since the loop began [s]
    mode_time: float  # since the mode began [s]
    hears: bool  # whether readings come
    is_up: bool  # whether standing up is over


class Operator(Protocol):
    """Asked once in each cycle."""

    def wish(self, status: LoopStatus) -> Wish | None:
        """Return what is wanted now, if anything."""


class Keyboard:
    """Reads words from a terminal, in a thread: ``arm``, ``stand``, ``run``, ``sit``, ``stop``, ...

    An empty line stops at once: whoever is in a hurry hits Enter.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._said: SimpleQueue[Wish] = SimpleQueue()
        self._say = say
        if isinstance(sys.stdin, TextIOWrapper):  # a byte that is no letter must not end listening
            sys.stdin.reconfigure(errors="replace")
        threading.Thread(target=self._listen, name="keyboard", daemon=True).start()

    def ask(self, wish: Wish) -> None:
        """Wish for something, as if it were typed."""
        self._said.put(wish)

    def wish(self, status: LoopStatus) -> Wish | None:
        """Return the next word."""
        try:
            return self._said.get_nowait()
        except Empty:
            return None

    def _listen(self) -> None:
        for line in sys.stdin:
            word = line.strip().lower()
            if not word:
                self._said.put(Wish.STOP)
            elif word in list(Wish):
                self._said.put(Wish(word))
            else:
                self._say(f"not understood: {word}; one of: {', '.join(Wish)}")
        self._said.put(Wish.SIT)  # the terminal is gone


class Script:
    """Arms, stands up, runs for some time, sits down and ends, without anybody: for simulators.

    Parameters
    ----------
    seconds:
        How long the controller runs [s].
    settle:
        How long the robot stands before [s].
    """

    def __init__(self, seconds: float, settle: float = 0.5) -> None:
        self._seconds, self._settle = seconds, settle
        self._was_up = False
        self._asked: Wish | None = None

    def ask(self, wish: Wish) -> None:
        """Wish for something else now."""
        self._asked = wish

    def wish(self, status: LoopStatus) -> Wish | None:
        """Return the next step when it is time."""
        if self._asked is not None:
            asked, self._asked = self._asked, None
            return asked
        mode, passed = status.mode, status.mode_time
        if mode is Mode.IDLE and status.hears and not self._was_up:
            return Wish.ARM
        if mode is Mode.DAMPING and passed > self._settle:
            return Wish.QUIT if self._was_up else Wish.STAND
        if mode is Mode.STANDING_UP:
            self._was_up = True  # or was on its way when something stopped it
            return Wish.RUN if status.is_up else None
        if mode is Mode.RUNNING and passed > self._seconds:
            return Wish.SIT
        return Wish.QUIT if mode is Mode.STOP and passed > self._settle else None
