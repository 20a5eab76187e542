"""The base's state from IMUs, encoders and contacts: one update per message.

IMU -> predict -> joints -> feet seen from the IMU -> who bears -> hold, correct or release each
    -> base pose and velocity -> forces by momentum residuals, for who bears in the next update

The arithmetic is the core's (``source/estimator.c``).
"""

from __future__ import annotations

import logging
from bisect import bisect_left
from collections import deque
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, shown
from wbc.estimation.beginning import Beginning
from wbc.estimation.contact_filter import SHOWN
from wbc.estimation.core import EstimatorCore, EstimatorMemory
from wbc.estimation.estimate import Estimate
from wbc.estimation.joint_velocity import JointVelocityFilter
from wbc.estimation.measurement import ImuMount, Measurement
from wbc.estimation.notes import noted
from wbc.estimation.settings import EstimatorSettings
from wbc.kinds import check_kind
from wbc.native import doubles, ffi, lib, pointer
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.validate import Array, list_of

OLD_IN_A_ROW = 50  # messages that are dropped for their age before it is said


class StateEstimator:
    """Estimates the base of a robot from its sensors; see the page *Estimate*.

    In the beginning the robot stands still for ``standing_time``; :meth:`update` returns None until
    then. Heading and position are relative to that stance: nothing observes them, and their
    variance only grows.

    Parameters
    ----------
    robot:
        With a floating base, and feet.
    imus:
        Where they are; the first one leads as long as it is heard. Those on its link are averaged
        with it, to one in their middle; others wait to take over. By default one at the base.
    settings:
        Others than those of :class:`~wbc.estimation.EstimatorSettings`, by name.

    Attributes
    ----------
    robot, imus, settings:
        As given.
    core:
        As the core has it.
    velocity_delay:
        How old joint velocities are that come from encoders alone [s].
    notes:
        What an estimate does not know, in words.

    Raises
    ------
    InvalidInputError
        A robot whose base is bolted, or without feet, or a setting out of range.
    UnknownNameError
        An IMU on a frame that is none.
    """

    def __init__(
        self,
        robot: Robot,
        imus: Sequence[ImuMount] | ImuMount = (),
        settings: EstimatorSettings | None = None,
        *,
        dt: float = 0.002,
    ) -> None:
        check_robot("estimator, robot", robot)
        if robot.fixed_base or not robot.feet:
            why = "its base is bolted" if robot.fixed_base else "no feet were found"
            raise InvalidInputError(
                f"estimator: {robot.name}: {why}; a base is estimated from feet that stand"
            )
        check_kind("estimator, settings", settings, EstimatorSettings, or_none=True)
        self.robot, self.settings = robot, settings or EstimatorSettings()
        given = (imus,) if isinstance(imus, ImuMount) else imus
        self.imus = list_of("estimator, imus", given, ImuMount, "ImuMount()") or (ImuMount(),)
        names = [one.name for one in self.imus]
        if len(set(names)) < len(names):
            raise InvalidInputError(f"estimator, imus: names must differ, got {names}")
        window = self.settings.velocity_window
        joints = robot.nv - BASE_NV
        self.velocity_delay = JointVelocityFilter(joints, window, dt).delay
        self._made = robot, self.imus, self.settings, dt
        self.core = EstimatorCore(robot, self.imus, self.settings, dt)
        self._beginning = Beginning(robot, self.imus, self.settings.standing_time, dt)
        self._shape, self._feet = (joints,), tuple(robot.feet)
        self._names = tuple(names), robot.joint_names, self._feet
        self._at_imu = {name: k for k, name in enumerate(names)}
        self._said = np.zeros((len(names), 6))
        self._heard = np.zeros(len(names), dtype=np.int64)
        self._loads = np.zeros(len(self._feet))
        self._sample = ffi.new(
            "wbc_sample *", {"imu": pointer(self._said), "heard": pointer(self._heard)}
        )
        self.notes = (
            "heading and position are relative to the start: nothing observes them, and their"
            " variance grows",
            f"joint velocities that are not measured are {1e3 * self.velocity_delay:.1f} ms old",
        )
        self.reset()

    def __repr__(self) -> str:
        names = ", ".join(one.name for one in self.imus)
        state = "standing to begin" if self._last is None else f"t={self._last.time:.3f} s"
        return f"StateEstimator({self.robot.name!r}, {names}, {state})"

    # ------------------------------------------------------------------ to begin

    def reset(self, q: ArrayLike | None = None) -> None:
        """Forget everything, and stand still to begin.

        Parameters
        ----------
        q:
            Configuration (nq,) whose base position and heading it is then; its tilt and joints are
            measured. None: heading 0, the soles' middle at the world's origin.

        Raises
        ------
        InvalidInputError
            An unusable configuration.
        """
        self.core.reset(None if q is None else self.robot.check_configuration(q))
        self._past: deque[tuple[Measurement, EstimatorMemory]] = deque(maxlen=self.settings.history)
        self._last: Estimate | None = None
        self._dropped = 0  # messages in a row
        self._beginning.anew()

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        waits, start, memory, self._past, self._last, self._beginning = state
        self.core.made["wait"][:], self.core.given["start"][:] = waits, start
        self.core.restore(memory)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to make it anew, and what it knows: what the core has is no object."""
        core = self.core
        known = core.made["wait"].copy(), core.given["start"].copy(), core.memory()
        state = (*known, self._past.copy(), self._last, copy(self._beginning))
        return partial(type(self), dt=self._made[-1]), self._made[:-1], state

    @property
    def kept_by(self) -> str:
        """Why there is no estimate yet, in words; empty once there is one."""
        return "" if self._last is not None else self._beginning.told

    # ------------------------------------------------------------------ messages

    def update(self, measurement: Measurement) -> Estimate | None:
        """Take in a message; return the estimate at the time of the latest one.

        None while it stands to begin; a warning says why, where that takes long. A message that
        comes late is filed where it belongs, and what
        followed is taken in again: to the same bits as in order. One that is older than
        ``history`` messages, or came twice, is dropped, and a note says so.

        Raises
        ------
        InvalidInputError
            A message of another robot, of other feet, or without any reading of the leading IMU to
            begin with; or one by which the robot stands on its head, as where an IMU says -g.
        """
        if not isinstance(measurement, Measurement) or measurement.positions.shape != self._shape:
            raise InvalidInputError(
                f"estimator: expected a Measurement of {self._shape[0]} joints,"
                f" got {shown(measurement)}"
            )
        last = self._last
        if last is None or measurement.time > last.time:
            return self._take(measurement)
        return self._file(last, measurement)

    def _file(self, last: Estimate, late: Measurement) -> Estimate | None:
        """Take in a message that is not the latest."""
        times = [one.time for one, _ in self._past]
        at = bisect_left(times, late.time)
        age = 1e3 * (last.time - late.time)
        if at < len(times) and times[at] == late.time:
            return replace(last, notes=("a message came twice; dropped",))
        if at == 0:
            kept = f"older than the last {len(times)} messages"
            self._dropped += 1
            if self._dropped == OLD_IN_A_ROW:
                logging.getLogger(__name__).warning(
                    "estimator: %d messages in a row are older than %g s; dropped, and so are all"
                    " until then: if the clock jumped back, reset() the estimator, or add %.3f s",
                    *(self._dropped, last.time, last.time - late.time),
                )
            return replace(last, notes=(f"a message is {age:.1f} ms late, {kept}; dropped",))
        again = [late, *(one for one, _ in list(self._past)[at:])]
        self.core.restore(self._past[at][1])
        for _ in range(len(times) - at):
            self._past.pop()
        for one in again:
            estimate = self._take(one)
        if estimate is None:  # it was begun before: there is one
            return None
        note = f"a message is {age:.1f} ms late; {len(again) - 1} were taken in again"
        return replace(estimate, notes=(*estimate.notes, note))

    def _take(self, m: Measurement) -> Estimate | None:
        core, sample, heard = self.core, self._sample, self._heard
        self._dropped = 0
        if self._last is not None and self.settings.history:
            self._past.append((m, core.memory()))
        heard[:] = 0
        for reading in m.imus:
            at = self._at_imu.get(reading.name)
            if at is not None:
                row = self._said[at]
                row[:3], row[3:] = reading.angular_velocity, reading.specific_force
                heard[at] = 1
        sample.time = m.time
        # The message keeps these arrays for as long as the core reads them.
        sample.positions = doubles(m.positions)
        sample.velocities = ffi.NULL if m.velocities is None else doubles(m.velocities)
        sample.torques = ffi.NULL if m.torques is None else doubles(m.torques)
        sample.loads = self._shares(m)
        out = np.empty(core.out)
        said = lib.wbc_estimator_update(core.struct, sample, doubles(out))
        if said == lib.STANDING:
            self._beginning.waits(m)
            return None
        if said != lib.DONE:
            raise InvalidInputError(self._why_none(said))
        estimate = self._estimate(m, out)
        if self._last is None:
            try:
                self._beginning.check(m, estimate)
            except InvalidInputError:
                lib.wbc_estimator_reset(core.struct)
                raise
        self._last = estimate
        return estimate

    def _shares(self, m: Measurement) -> Any:
        """Return what the core reads of the loads of the feet, in parts of the weight."""
        if m.forces is not None:
            self._loads[:] = self._by_foot("forces", m.forces)
            self._loads /= self.robot.weight
        elif m.contacts is not None:
            self._loads[:] = self._by_foot("contacts", m.contacts)
        else:
            return ffi.NULL
        return doubles(self._loads)

    def _by_foot(self, what: str, given: Mapping[str, float]) -> list[float]:
        if given.keys() != {*self._feet}:
            raise InvalidInputError(
                f"estimator, {what}: expected one for each of the feet {', '.join(self._feet)}, got"
                f" {', '.join(given) or 'none'}"
            )
        return [given[name] for name in self._feet]

    def _estimate(self, m: Measurement, out: Array) -> Estimate:
        nv, nq, count = self.robot.nv, self.robot.nq, len(self._feet)
        out.setflags(False)  # type: ignore[call-arg]  # parts of it are read-only, too
        numbers = self.core.counts.tolist()
        at, wrenches = lib.FEET_STAND, out[lib.OUT_WRENCHES : lib.OUT_WRENCHES + 6 * count]
        forces = {}
        if m.torques is not None:
            forces = {name: wrenches[6 * k : 6 * k + 6] for k, name in enumerate(self._feet)}
        return Estimate(
            m.time,
            out[-nq:],
            out[-nq - nv : -nq],
            out[: lib.OUT_GYRO].reshape(SHOWN, SHOWN),
            tuple(compress(self._feet, numbers[at : at + count])),
            tuple(compress(self._feet, numbers[at + count : at + 2 * count])),
            out[lib.OUT_GYRO : lib.OUT_ACCEL],
            out[lib.OUT_ACCEL : lib.OUT_SQUARED],
            forces,
            (float(out[lib.OUT_SQUARED]), numbers[lib.NIS_ROWS]),
            self._notes(),
        )

    def _notes(self) -> tuple[str, ...]:
        return noted(self.core, *self._names) if self.core.event[0] else ()

    def _why_none(self, said: int) -> str:
        """Return why there is no estimate, in words."""
        if said == lib.NO_IMU:
            leader = self.imus[self.core.counts[lib.LEADER]].name
            why = "".join(f"; {note}" for note in self._notes())
            return f"estimator: the first message has no usable reading of IMU {leader!r}{why}"
        if said == lib.NO_GRAVITY:
            gravity = np.linalg.norm(self.robot.model.gravity.linear)
            return (
                f"estimator: a robot at rest feels {gravity:.2f} m/s^2, the IMU says"
                f" {self.core.detail[0]:.2f}: are its units g, or is it falling?"
            )
        if said == lib.NOT_FINITE:
            return (
                "filter: the innovation of a foot has no positive covariance"
                f"{self._beginning.apart}"
            )
        return "estimator: the estimate is not finite; reset it"
