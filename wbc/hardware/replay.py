"""A log run again: estimator and controller answer what they were asked, to the same bits."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wbc.errors import InvalidInputError, listed
from wbc.hardware.log_file import HardwareLog
from wbc.hardware.log_row import reading_of, request_of
from wbc.hardware.robot_controller import ControllerAnswer
from wbc.hardware.setup import controller_of
from wbc.hardware.unitree.profiles import profile_named
from wbc.hardware.worker import done
from wbc.validate import Array

REPLAYED = "sensors"  # the estimator whose readings a log has


class LogReplay(NamedTuple):
    """A log that was run again.

    Attributes
    ----------
    asked, compared:
        How often the controller was asked, and of how many answers the bits were compared.
    differences:
        What is not the same, in words; empty if all is.
    """

    asked: int
    compared: int
    differences: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether everything that was compared is the same to the last bit."""
        return not self.differences

    def __str__(self) -> str:
        what = f"{self.compared} answers of {self.asked}"
        if self.same:
            return f"{what}: the same to the last bit"
        return f"{what}: not the same: {listed(self.differences, 6)}"


def replay_log(path: str | Path) -> LogReplay:
    """Ask estimator and controller again what a log says that they were asked, and compare.

    From the first time on that the robot stood still, armed, for the estimator to begin.

    Raises
    ------
    InvalidInputError
        Not a log; one that does not reach back so far; of the true state, which is in no log.
    ProblemFileError
        Its problem cannot be loaded.
    """
    log = HardwareLog.load(path)
    estimator, profile = str(log.made_of.get("estimator")), str(log.made_of.get("profile"))
    if estimator != REPLAYED:
        raise InvalidInputError(
            f"{path}: ran on the estimator {estimator!r}, whose input is in no log; one that ran on"
            f" {REPLAYED!r} can be run again"
        )
    parts = log.problem.parts
    controller = controller_of(
        log.problem.supervisor_on_robot(),
        parts.robot,
        profile_named(profile),
        parts.start,
        estimator,
    )
    rows, answers = dict[int, Mapping[str, Array]](), dict[int, ControllerAnswer | None]()
    asked, compared, last, differences = 0, 0, -1, list[str]()
    for row in log.rows():
        if np.isfinite(row["sequence"]):
            rows[int(row["sequence"])] = row  # the latest: a robot may count anew
        if np.isfinite(row["asked"]):
            about = int(row["asked_about"])
            if about not in rows:
                raise InvalidInputError(
                    f"{path}: reading {about}, that was asked about, is missing"
                )
            job = request_of(row, reading_of(rows[about]))
            if asked or (job.begins and not job.commands):
                asked += 1
                answers[about] = done(controller, job).answer
        to = int(row["answer_to"]) if np.isfinite(row["answer_to"]) else -1
        if to != last and to in answers:
            compared += 1
            differences += _differences(row, answers[to])
        last = to
    if not asked:
        raise InvalidInputError(
            f"{path}: does not reach back to where the estimator began; wbc hardware run --keep"
            " SECONDS keeps more"
        )
    return LogReplay(asked, compared, tuple(differences))


def _differences(row: Mapping[str, Array], answer: ControllerAnswer | None) -> list[str]:
    at = f"at {float(row['time']):.4f} s"
    if answer is None:
        return [f"{at}: no answer any more"]
    command = answer.command
    now = {"q": answer.q, "v": answer.v}
    if command is not None:
        now |= {"answer_velocity": command.velocity, "answer_torque": command.torque}
    return [
        f"{at}: {name} by {np.abs(array - row[name]).max():.3g}"
        for name, array in now.items()
        if array.tobytes() != np.ascontiguousarray(row[name]).tobytes()
    ]
