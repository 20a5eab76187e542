"""What a loop logs in each cycle."""

from __future__ import annotations

from numpy.typing import ArrayLike

from wbc.hardware.bus import Command, Reading
from wbc.hardware.real_time import Beat
from wbc.hardware.robot_controller import ControllerAnswer
from wbc.hardware.safety import Fault, Mode, Safety

MODES = tuple(Mode)
FAULTS = tuple(Fault)


def log_fields(joints: int, nq: int, nv: int) -> dict[str, int]:
    """Return what a log's rows hold, and how many numbers each field has."""
    single = ("time", "lateness", "mode", "faults", "sequence", "robot_time")
    many = (
        "position",
        "velocity",
        "torque",
        "temperature",
        "command_position",
        "command_velocity",
        "command_torque",
        "kp",
        "kd",
    )
    fields = dict.fromkeys(single, 1) | dict.fromkeys(many, joints)
    return fields | {
        "quaternion": 4,
        "angular_velocity": 3,
        "specific_force": 3,
        "q": nq,
        "v": nv,
    }


def log_row(
    beat: Beat,
    safety: Safety,
    command: Command,
    reading: Reading | None,
    answer: ControllerAnswer | None,
) -> dict[str, ArrayLike]:
    """Return a row: modes by their place in :class:`Mode`, faults as bits by theirs."""
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
    if reading is not None:
        values |= {
            "sequence": reading.sequence,
            "robot_time": reading.time,
            "position": reading.position,
            "velocity": reading.velocity,
            "torque": reading.torque,
            "temperature": reading.temperature,
            "quaternion": reading.quaternion,
            "angular_velocity": reading.angular_velocity,
            "specific_force": reading.specific_force,
        }
    if answer is not None:
        values |= {"q": answer.q, "v": answer.v}
    return values
