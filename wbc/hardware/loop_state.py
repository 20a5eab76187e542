"""The state of a loop from cycle to cycle."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field

from wbc.hardware.bus import Command, Reading
from wbc.hardware.robot_controller import ControllerAnswer
from wbc.hardware.safety import Mode
from wbc.hardware.worker import Job


@dataclass
class LoopState:
    """The state of a loop, without the safety layer and the checks."""

    command: Command  # the last
    reading: Reading | None = None
    last_reading_time: float = -math.inf  # arrival of the last usable reading
    previous: Reading | None = None  # the usable reading before
    waited: int = 0  # cycles since a tick was last due
    request: Job | None = None  # to the controller, in this cycle
    request_sequence: int = -1  # number of the reading of the last request
    answer_sequence: int = -1  # number of the reading of the newest answer
    answer_duration: float = math.nan  # of that answer, from reading to command [s]
    last_answer_time: float = 0.0  # of the controller
    held_cycles: int = 0  # cycles that held the last command, as the controller was busy
    pending_reading: Reading | None = None  # of the next request
    is_observing: bool = False  # whether the estimator has begun
    is_commanding: bool = False  # whether the controller has begun
    time: float = 0.0  # of this cycle
    answer: ControllerAnswer | None = None
    error: str = ""  # the controller's last error in place of an answer
    sequence: int = 0
    mode: Mode = Mode.IDLE
    mode_start: float = 0.0
    runs_when_up: bool = False  # whether run was requested on the way up
    waits: bool = False  # whether the controller balances, and the problem has not begun
    load_time: float = 0.0  # when the feet last bore enough of the weight
    is_stale: bool = False  # whether the controller's next answer is to an earlier mode's request
    sit_deadline: float | None = None  # latest time to begin going down
    log_time: float | None = None
    event: str = ""
    ended: str = ""
    had_fault: bool = False  # whether a fault ever stopped the robot
    notes: tuple[str, ...] = ()
    missed: int = 0
    silence_reported: bool = False  # whether the operator was told of the silence
    # Of all cycles: 14 MB an hour.
    lateness: array[float] = field(default_factory=lambda: array("d"))
    seconds: array[float] = field(default_factory=lambda: array("d"))  # of all ticks
