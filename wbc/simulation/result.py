"""The result of a simulation: stood or fell, what was relaxed, torque use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.constraints.com_support import support_polygon
from wbc.errors import listed
from wbc.notebook import as_html, with_picture
from wbc.polygon import polygon_margin
from wbc.robot import Robot, Snapshot
from wbc.run.columns import Column, Frame, frame_of
from wbc.run.result import Result
from wbc.run.saving import plain, save_result
from wbc.run.stopping import RunStatus
from wbc.simulation.falling import Verdict
from wbc.simulation.plant import Plant
from wbc.simulation.push import AppliedWrench, Push
from wbc.simulation.recorder import Recorder
from wbc.simulation.terrain import Terrain
from wbc.simulation.trial_record import TrialRecord
from wbc.tracking.deviation import Followed, PlanTracking, evaluate_tracking
from wbc.validate import Array

# A foot that bears less than this part of the robot's weight does not widen the support.
MIN_LOAD = 1e-3
# A torque within the solvers' tolerance of its bound is at it.
AT_BOUND = 1.0 - 1e-6


class SimulationStatus(StrEnum):
    """How a simulation ended.

    ``STOOD``: to its end, and every tolerance was met. ``FELL``. ``NOT_REACHED``: a tolerance was
    not met. ``NOT_KEPT``: a condition of ``stop`` was violated in some tick. ``QP_FAILED``: a tick
    had no solution, even with everything but physics relaxed. ``NOT_STANDING``: a phase could not
    begin. ``INTERRUPTED``: it was cancelled.
    """

    STOOD = "stood"
    FELL = "fell"
    NOT_REACHED = "not_reached"
    NOT_KEPT = "not_kept"
    QP_FAILED = "qp_failed"
    NOT_STANDING = "not_standing"
    INTERRUPTED = "interrupted"

    @property
    def good(self) -> bool:
        """Whether the simulation succeeded."""
        return self is SimulationStatus.STOOD


@dataclass(frozen=True, eq=False)
class SimulationResult:
    """The result of a simulation.

    Attributes
    ----------
    run:
        Of the controller: tasks, contacts, margins, ticks.
    verdict:
        Whether the robot stood, until when, and why it fell.
    arrays:
        Rows from the first state to the last, see :meth:`save`.
    pushes, wrenches:
        All pushes and longer wrenches.
    relaxed:
        Share of relaxed ticks, in [0, 1].
    gave_way:
        The same by the name of what was relaxed, the most frequent first.
    lost:
        Number of control periods without a measurement.
    saturated:
        Share of the control periods in which a joint was at its torque bound, by joint, where it is
        above 0.
    torque_use:
        Largest ratio of torque to bound, by joint that has one.
    terrain:
        The ground.
    tracking:
        Tracking errors of a plan, if there was one.
    """

    run: Result
    verdict: Verdict
    arrays: Mapping[str, NDArray[Any]]
    pushes: Sequence[Push]
    wrenches: Sequence[AppliedWrench]
    relaxed: float
    gave_way: Mapping[str, float]
    lost: int
    saturated: Mapping[str, float]
    torque_use: Mapping[str, float]
    recorder: Recorder
    notes: Sequence[str]
    terrain: Terrain
    tracking: PlanTracking | None = None

    @classmethod
    def of(
        cls,
        run: Result,
        plant: Plant,
        record: TrialRecord,
        bounds: Array,
        plan: Followed | None = None,
    ) -> SimulationResult:
        """Return the result of a trial; ``bounds`` (nv - 6,) are those on the torques."""
        robot, truth, ticks = plant.robot, record.truth.arrays(), record.ticks
        used = np.abs(truth["torque"][1:])
        ratio = np.divide(used, bounds, out=np.zeros_like(used), where=bounds > 0.0)  # 0: no motor
        peaks = dict(zip(robot.joint_names, ratio.max(axis=0, initial=0.0).tolist(), strict=True))
        at_bound = (ratio >= AT_BOUND).mean(axis=0) if len(ratio) else np.zeros(len(bounds))
        shares = zip(robot.joint_names, at_bound.tolist(), strict=True)
        tracking = None if plan is None else evaluate_tracking(plan, robot, truth)
        return cls(
            run=run,
            verdict=record.verdict,
            arrays={
                **_tick_arrays(run, len(record.truth)),
                **truth,
                "tilt": np.array(record.tilt),
                "cop_margin": cop_margin(robot, truth),
                **({} if tracking is None else tracking.arrays),
            },
            pushes=record.pushes,
            wrenches=record.wrenches,
            relaxed=record.relaxed / ticks,
            gave_way={name: count / ticks for name, count in record.gave_way.most_common()},
            lost=record.lost,
            saturated=_descending({name: share for name, share in shares if share > 0.0}),
            torque_use=_descending(
                {name: peaks[name] for name, bound in zip(peaks, bounds, strict=True)
                 if np.isfinite(bound)}
            ),
            recorder=record.truth,
            notes=record.notes,
            terrain=plant.terrain,
            tracking=tracking,
        )  # fmt: skip

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.run.robot

    @property
    def status(self) -> SimulationStatus:
        """How it ended."""
        if not self.verdict.stood:
            return SimulationStatus.FELL
        if self.run.status.good or self.run.status is RunStatus.TIMEOUT:
            return SimulationStatus.STOOD
        return SimulationStatus(self.run.status.value)

    @property
    def reason(self) -> str:
        """Why, in words."""
        if self.status in (SimulationStatus.STOOD, SimulationStatus.FELL):
            return self.verdict.reason
        return f"{self.verdict.reason}; {self.run.reason}"

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        return float(self.arrays["time"][-1])

    @property
    def least_cop_margin(self) -> float:
        """Smallest distance of the CoP inside the loaded soles [m]; NaN if none was."""
        margin = self.arrays["cop_margin"]
        return float(np.nanmin(margin)) if np.isfinite(margin).any() else float("nan")

    @property
    def peak_tilt(self) -> float:
        """Largest angle of the trunk from its initial vertical [rad]."""
        return float(self.arrays["tilt"].max())

    @property
    def cop_error(self) -> float:
        """Root mean square distance of the CoP from the controller's [m]."""
        offsets = self.arrays["cop"][:, :2] - self.arrays["planned_cop"][:, :2]
        known = np.square(offsets).sum(axis=1)[np.isfinite(offsets).all(axis=1)]
        return float(np.sqrt(known.mean())) if known.size else float("nan")

    @property
    def torque_change(self) -> Mapping[str, float]:
        """Root mean square change of torques from tick to tick [N m or N], the largest first.

        Chattering torques wear gears and are heard: gains are too high for springs and noise.
        """
        steps = np.diff(self.arrays["torque"][1:], axis=0)
        rms = np.sqrt(np.square(steps).mean(axis=0)) if len(steps) else np.zeros(steps.shape[1])
        return _descending(dict(zip(self.robot.joint_names, rms.tolist(), strict=True)))

    def summary(self) -> dict[str, Any]:
        """Return everything but the histories as plain data."""
        return {
            **self.run.summary(),
            "status": self.status.value,
            "reason": self.reason,
            "mass": self.robot.mass,
            "simulation": {
                "stood": self.verdict.stood,
                "verdict": self.verdict.reason,
                "duration": self.duration,
                "pushes": [_acting_summary(push) for push in self.pushes],
                "wrenches": [_acting_summary(wrench) for wrench in self.wrenches],
                "relaxed": self.relaxed,
                "gave_way": dict(self.gave_way),
                "lost_frames": self.lost,
                "least_cop_margin": self.least_cop_margin,
                "cop_error_rms": self.cop_error,
                "peak_tilt": self.peak_tilt,
                "saturated": dict(self.saturated),
                "torque_use": dict(self.torque_use),
                "torque_change_rms": dict(self.torque_change),
                "notes": list(self.notes),
                "terrain": self.terrain.to_data(),
            },
            **({} if self.tracking is None else {"plan": self.tracking.summary()}),
        }

    def save(self, path: str | Path) -> None:
        """Write the summary (.json), with the arrays (.npz), or a table (.csv, .parquet).

        Rows of the arrays are the states between ticks, from the first to the last: those of
        :class:`~wbc.simulation.recorder.Recorder`, ``tilt`` of the trunk [rad] and ``cop_margin``,
        the CoP's distance inside the loaded soles [m]; and those of :class:`~wbc.run.History`, of
        the tick that began in each state, as the controller measured it; the last row repeats the
        last tick.

        Raises
        ------
        InvalidInputError
            Another ending.
        OSError
            The file cannot be written.
        """
        save_result(path, self.summary(), lambda: self.arrays, self._columns)

    def to_frame(self) -> Frame:
        """Return the states as a pandas data frame: a row per state, the columns of a table.

        Raises
        ------
        MissingPackageError
            pandas is not installed.
        """
        return frame_of(self._columns())

    def _repr_html_(self) -> str:
        """Return the HTML of a notebook."""
        facts = [
            ("robot", self.robot.name),
            ("simulated", f"{self.duration:g} s"),
            ("gave way", listed([f"{name} in {100 * part:.2g} % of ticks" for name, part in
                                 self.gave_way.items()])),
            ("CoP inside soles", f"{1e3 * self.least_cop_margin:.1f} mm at least"),
            ("trunk's tilt", f"{np.degrees(self.peak_tilt):.2g} degrees at most"),
            ("at torque bound", listed([f"{name} for {100 * part:.2g} %" for name, part in
                                        self.saturated.items()])),
        ]  # fmt: skip
        table = as_html(f"{self.status.value.replace('_', ' ')}: {self.reason}", facts)
        figure = "wbc.view.simulation:simulation_figure"
        return with_picture(table, figure, self.robot, self.arrays, "", self.terrain)

    def _columns(self) -> list[Column]:
        return [
            *self.recorder.columns(),
            ("trunk/tilt [rad]", self.arrays["tilt"]),
            ("cop/inside_soles [m]", self.arrays["cop_margin"]),
        ]


def cop_margin(robot: Robot, truth: Mapping[str, Array]) -> Array:
    """Return the CoP's distance inside the loaded soles (n,) [m]; NaN in the air, and at the start.

    Of the soles alone: a hand on the ground changes neither. Before the first step rounding says
    which soles touch: one of six bore the weight there is without torques.

    ``truth``: arrays of a :class:`~wbc.simulation.recorder.Recorder`.
    """
    margins = np.full(len(truth["time"]), np.nan)
    min_load = MIN_LOAD * robot.weight
    feet = {name: foot.frame for name, foot in robot.feet.items()}
    for k, q in enumerate(truth["q"][1:], start=1):
        wrenches = {name: truth[f"forces/{frame}"][k] for name, frame in feet.items()}
        loaded = {name: one for name, one in wrenches.items() if one[2] > min_load}
        if loaded:
            snapshot = robot.snapshot(q)
            cop = _cop(snapshot, {feet[name]: one for name, one in loaded.items()})
            margins[k] = float(polygon_margin(support_polygon(snapshot, loaded), cop))
    return margins


def _cop(snapshot: Snapshot, wrenches: Mapping[str, Array]) -> Array:
    """Return the CoP (2,) of soles from the wrench at each frame, each on its own plane."""
    total, weighted = 0.0, np.zeros(3)
    for frame, wrench in wrenches.items():
        R = snapshot.rotation(frame)
        force, moment = R.T @ wrench[:3], R.T @ wrench[3:]
        on_sole = np.array((-moment[1] / force[2], moment[0] / force[2], 0.0))
        weighted += force[2] * (snapshot.position(frame) + R @ on_sole)
        total += force[2]
    return weighted[:2] / total


def _tick_arrays(run: Result, rows: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of the ticks, the last row repeated up to ``rows``."""
    arrays = run.history.arrays()
    count = len(run.history)
    return {
        name: np.concatenate((one, np.repeat(one[-1:], rows - count, axis=0)))
        if one.ndim and len(one) == count and not name.startswith("obstacles/")
        else one
        for name, one in arrays.items()
    }


def _descending(shares: Mapping[str, float]) -> dict[str, float]:
    return dict(sorted(shares.items(), key=lambda one: -one[1]))


def _acting_summary(one: Push | AppliedWrench) -> dict[str, Any]:
    data = {**plain(one), "at": one.start}
    del data["start"]
    if isinstance(one, Push):
        return {**data, "impulse": plain(one.impulse)}
    return {**data, "duration": one.duration if np.isfinite(one.duration) else None}
