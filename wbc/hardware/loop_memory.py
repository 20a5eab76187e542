"""What a loop remembers from cycle to cycle."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field

from wbc.hardware.bus import Command, Reading
from wbc.hardware.robot_controller import ControllerAnswer
from wbc.hardware.safety import Mode
from wbc.hardware.worker import Job


def _numbers() -> array[float]:
    return array("d")


@dataclass
class LoopMemory:
    """All that changes while a loop runs, but for the safety layer and the checks."""

    reading: Reading | None = None
    heard: float = -math.inf  # when the last usable reading came
    before: Reading | None = None  # the one before
    turn: int = 0  # cycles since the controller was last to be asked
    asked: Job | None = None  # of the controller, in this cycle
    asked_last: int = -1  # the number of the last reading it was asked about
    answer_to: int = -1  # of the reading that its newest answer is about
    took: float = math.nan  # what that took, from reading to command [s]
    answered: float = 0.0  # when it last answered
    held: int = 0  # cycles for which a command was wanted that was not there
    waiting: Reading | None = None  # what the controller is to be asked about
    stands: bool = False  # whether the controller was told that the robot stands
    runs: bool = False  # and that it runs
    time: float = 0.0  # of this cycle
    answer: ControllerAnswer | None = None
    error: str = ""  # what its process said last in place of an answer
    command: Command | None = None
    sequence: int = 0
    mode: Mode = Mode.IDLE
    mode_began: float = 0.0
    sits_by: float | None = None  # when going down begins at the latest
    log_at: float | None = None
    event: str = ""
    ended: str = ""
    stopped: bool = False  # whether a fault stopped it, be it long ago
    notes: tuple[str, ...] = ()
    missed: int = 0
    told: bool = False  # whether it was said that nothing is heard
    lateness: array[float] = field(default_factory=_numbers)  # of all cycles: 14 MB an hour
    seconds: array[float] = field(default_factory=_numbers)
