"""Replay of a log: estimator and controller repeat their answers, to the same bits."""

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
from wbc.hardware.worker import run_job
from wbc.validate import Array

REPLAYABLE = "sensors"  # the estimator whose input is in a log


class LogReplay(NamedTuple):
    """The replay of a log."""

    # numbers of requests to the controller, and of compared answers
    asked: int
    compared: int
    differences: tuple[str, ...]  # in words; empty if there are none

    @property
    def same(self) -> bool:
        """Whether all compared answers are the same to the last bit."""
        return not self.differences

    def __str__(self) -> str:
        what = f"{self.compared} answers of {self.asked}"
        if self.same:
            return f"{what}: the same to the last bit"
        return f"{what}: not the same: {listed(self.differences, 6)}"


def replay_log(path: str | Path) -> LogReplay:
    """Repeat a log's requests to estimator and controller, and compare their answers.

    It begins where the estimator first began.

    Raises InvalidInputError: not a log; one that does not reach back to that; of an estimator whose
    input is not logged; ProblemFileError: its problem cannot be loaded.
    """
    log = HardwareLog.load(path)
    estimator, profile = str(log.made_of.get("estimator")), str(log.made_of.get("profile"))
    if estimator != REPLAYABLE:
        raise InvalidInputError(
            f"{path}: ran on the estimator {estimator!r}, whose input is in no log; one that ran on"
            f" {REPLAYABLE!r} can be run again"
        )
    controller = controller_of(log.problem, profile_named(profile), estimator)
    rows, answers = dict[int, Mapping[str, Array]](), dict[int, ControllerAnswer | None]()
    asked, compared, last, differences = 0, 0, -1, list[str]()
    for row in log.rows():
        if np.isfinite(row["sequence"]):
            rows[int(row["sequence"])] = row  # the latest: a restarted robot counts from 0
        if np.isfinite(row["asked"]):
            sequence = int(row["asked_about"])
            if sequence not in rows:
                raise InvalidInputError(
                    f"{path}: reading {sequence}, that was asked about, is missing"
                )
            job = request_of(row, reading_of(rows[sequence]))
            if asked or (job.begins and not job.wants_command):
                asked += 1
                answers[sequence] = run_job(controller, job).answer
        answered = int(row["answer_to"]) if np.isfinite(row["answer_to"]) else -1
        if answered != last and answered in answers:
            compared += 1
            differences += _differences(row, answers[answered])
        last = answered
    if not np.isfinite(log.arrays["asked"]).any():
        raise InvalidInputError(
            f"{path}: nothing was asked of estimator and controller: the robot did not stand up"
        )
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
    values = {"q": answer.q, "v": answer.v}
    if command is not None:
        values |= {"answer_velocity": command.velocity, "answer_torque": command.torque}
    return [
        f"{at}: {name} by {np.abs(array - row[name]).max():.3g}"
        for name, array in values.items()
        if array.tobytes() != np.ascontiguousarray(row[name]).tobytes()
    ]
