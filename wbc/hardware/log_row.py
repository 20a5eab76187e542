"""The log row of a cycle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from wbc.hardware.bus import IMU_ROWS, JOINT_ROWS, ROWS, Command, Reading
from wbc.hardware.loop_state import LoopState
from wbc.hardware.real_time import Beat
from wbc.hardware.safety import Fault, Mode, Safety
from wbc.hardware.worker import Job
from wbc.validate import Array

MODES = tuple(Mode)
FAULTS = tuple(Fault)


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
