"""The state of a loop from cycle to cycle, and the log row of a cycle."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from wbc.hardware.bus import IMU_ROWS, JOINT_ROWS, ROWS, Command, Reading
from wbc.hardware.real_time import Beat
from wbc.hardware.robot_controller import ControllerAnswer
from wbc.hardware.safety import Fault, Mode, Safety
from wbc.hardware.worker import Job
from wbc.validate import Array

MODES = tuple(Mode)
FAULTS = tuple(Fault)


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


def log_fields(joints: int, nq: int, nv: int) -> dict[str, int]:
    """Return the fields of a log's rows, and their numbers of values."""
    single = ("time", "lateness", "mode", "faults", "sequence", "robot_time", "stop")
    asked = ("asked", "asked_about", "answer_to", "answer_time", "standing")
    commanded = ("command_position", "command_velocity", "command_torque", "kp", "kd")
    many = (*JOINT_ROWS, *commanded, "answer_velocity", "answer_torque")
    fields = dict.fromkeys((*single, *asked), 1) | dict.fromkeys(many, joints)
    fields |= zip(IMU_ROWS, (4, 3, 3), strict=True)
    return fields | {"deviations": 4, "q": nq, "v": nv}


def log_row(
    beat: Beat, safety: Safety, command: Command, state: LoopState, feet: Sequence[str]
) -> dict[str, ArrayLike]:
    """Return a row: modes by their index in :class:`Mode`, faults and feet in contact as bits.

    The request to the controller in this cycle is logged as :func:`request_bits`, with the number
    of its reading; the newest answer with the number of its reading.
    """
    values: dict[str, ArrayLike] = {
        "time": beat.time,
        "lateness": beat.lateness,
        "mode": MODES.index(safety.mode),
        "faults": sum(1 << FAULTS.index(one) for one in safety.present),
        "command_position": command.position,
        "command_velocity": command.velocity,
        "command_torque": command.torque,
        "kp": command.kp,
        "kd": command.kd,
    }
    reading, answer = state.reading, state.answer
    if reading is not None:
        values |= {"sequence": reading.sequence, "robot_time": reading.time, "stop": reading.stop}
        values |= {name: getattr(reading, name) for name in ROWS}
    if state.request is not None:
        values["asked"] = request_bits(state.request)
        values["asked_about"] = state.request.reading.sequence
    if answer is not None:
        values |= {"q": answer.q, "v": answer.v, "answer_to": state.answer_sequence}
        values |= {"answer_time": state.answer_duration, "deviations": answer.sure.deviations}
        values["standing"] = sum(1 << feet.index(foot) for foot in answer.sure.feet)
        if answer.command is not None:
            values["answer_velocity"] = answer.command.velocity
            values["answer_torque"] = answer.command.torque
    return values


def request_bits(job: Job) -> int:
    """Return a request as bits: 1 if it begins, 2 for a command, 4 to come to rest, 8 to wait."""
    return job.begins + 2 * job.wants_command + 4 * job.comes_to_rest + 8 * job.waits


def request_of(row: Mapping[str, Array], reading: Reading) -> Job:
    """Return the job of a row's bits."""
    bits = int(row["asked"])
    return Job(reading, *(bool(bits & bit) for bit in (1, 2, 4, 8)))


def reading_of(row: Mapping[str, Array]) -> Reading:
    """Return the reading in a row."""
    number, time, stop = int(row["sequence"]), float(row["robot_time"]), bool(row["stop"])
    q, v, torque, heat, quaternion, spin, force = (np.array(row[name]) for name in ROWS)
    return Reading(number, time, q, v, torque, heat, quaternion, spin, force, stop)


def bits_set(value: float) -> list[int]:
    """Return the indices of the set bits of a number; none for NaN."""
    whole = int(value) if np.isfinite(value) else 0
    return [k for k in range(whole.bit_length()) if whole >> k & 1]
