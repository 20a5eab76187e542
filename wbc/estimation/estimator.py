"""The base's state from IMUs, encoders and contacts: one update per message.

IMU -> predict -> joints -> feet relative to the IMU -> loads -> hold, correct or release each foot
    -> base pose and velocity -> forces by momentum residuals, for the loads of the next update

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
from wbc.estimation.contact_filter import STATE_SIZE
from wbc.estimation.core import EstimatorCore, EstimatorMemory
from wbc.estimation.estimate import Estimate, notes_of
from wbc.estimation.initialization import Initialization
from wbc.estimation.joint_velocity import JointVelocityFilter
from wbc.estimation.measurement import ImuMount, Measurement
from wbc.estimation.settings import EstimatorSettings
from wbc.kinds import check_kind
from wbc.native import doubles, ffi, lib, pointer
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.notes import doubt_delay
from wbc.robot.postures import NEUTRAL
from wbc.validate import Array, list_of

OLD_MESSAGES_WARNING = 50  # number of messages in a row dropped for their age before a warning
MAX_FLIGHT = 1.0  # s without a foot that stands before a note: a fall of 5 m
FAR_MOUNT = 2.0  # m: no IMU is that far from the frame that carries it


class StateEstimator:
    """Estimates the base of a robot from its sensors; see the page *Estimate*.

    At first the robot stands still for ``standing_time``; :meth:`update` returns None until then.
    Heading and position are relative to that stance: they are unobservable, and their variance only
    grows.

    Parameters
    ----------
    robot:
        With a floating base, and feet.
    imus:
        Their mounts; the first one is the primary as long as it sends. Those on its link are
        averaged with it, to one in their middle; others are backups. By default one at the base.
    settings:
        By default those of :class:`~wbc.estimation.EstimatorSettings`.
    dt:
        Time between messages [s].

    Attributes
    ----------
    robot, imus, settings:
        As given.
    core:
        The core's estimator.
    velocity_delay:
        Delay of joint velocities from encoders alone [s].
    notes:
        Limits of every estimate, in words.

    Raises
    ------
    InvalidInputError
        A robot with a fixed base or without feet, or a setting out of range.
    UnknownNameError
        An IMU on an unknown frame.
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
            reason = "its base is bolted" if robot.fixed_base else "no feet were found"
            raise InvalidInputError(
                f"estimator: {robot.name}: {reason}; a base is estimated from feet that stand"
            )
        check_kind("estimator, settings", settings, EstimatorSettings, or_none=True)
        self.robot, self.settings = robot, settings or EstimatorSettings()
        given = (imus,) if isinstance(imus, ImuMount) else imus
        self.imus = list_of("estimator, imus", given, ImuMount, "ImuMount()") or (ImuMount(),)
        names = [one.name for one in self.imus]
        if len(set(names)) < len(names):
            raise InvalidInputError(f"estimator, imus: names must differ, got {names}")
        _doubt_units(self.imus, self.settings)
        window = self.settings.velocity_window
        joints = robot.nv - BASE_NV
        self.velocity_delay = JointVelocityFilter(joints, window, dt).delay
        self._arguments = robot, self.imus, self.settings, dt
        self.core = EstimatorCore(robot, self.imus, self.settings, dt)
        self._start = Initialization(robot, self.imus, self.settings.standing_time, dt)
        self._shape, self._feet = (joints,), tuple(robot.feet)
        self._names = tuple(names), robot.joint_names, self._feet
        self._imu_index = {name: k for k, name in enumerate(names)}
        self._imu_rows = np.zeros((len(names), 6))
        self._imu_present = np.zeros(len(names), dtype=np.int64)
        self._loads = np.zeros(len(self._feet))
        self._sample = ffi.new(
            "wbc_sample *", {"imu": pointer(self._imu_rows), "heard": pointer(self._imu_present)}
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

    # ------------------------------------------------------------------ state

    def reset(self, q: ArrayLike | None = None) -> None:
        """Restart; the robot stands still.

        Parameters
        ----------
        q:
            Configuration (nq,) with the initial base position and heading; tilt and joints are
            measured. None: heading 0, the soles' middle at the world's origin.

        Raises
        ------
        InvalidInputError
            An unusable configuration.
        """
        self.core.reset(None if q is None else self.robot.check_configuration(q))
        history = self.settings.history
        self._history: deque[tuple[Measurement, EstimatorMemory]] = deque(maxlen=history)
        self._last: Estimate | None = None
        self._stood_at = -np.inf  # the last time at which a foot stood [s]
        self._dropped = 0  # messages in a row
        self._start.reset()

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        waits, start, memory, self._history, self._last, self._start, self._stood_at = state
        self.core.made["wait"][:], self.core.given["start"][:] = waits, start
        self.core.restore(memory)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return constructor, arguments and state: the core's struct cannot be pickled."""
        core = self.core
        known = core.made["wait"].copy(), core.given["start"].copy(), core.memory()
        state = (*known, self._history.copy(), self._last, copy(self._start), self._stood_at)
        return partial(type(self), dt=self._arguments[-1]), self._arguments[:-1], state

    @property
    def kept_by(self) -> str:
        """Why there is no estimate yet, in words; else empty."""
        return "" if self._last is not None else self._start.status

    # ------------------------------------------------------------------ messages

    def update(self, measurement: Measurement) -> Estimate | None:
        """Process a message; return the estimate at the time of the latest one.

        None during initialisation; a warning says why, where that takes long. A late message is
        inserted at its time, and those after it are processed again: to the same bits as in order.
        One that is older than ``history`` messages, or a duplicate, is dropped, and a note says so.

        Raises
        ------
        InvalidInputError
            A message of another robot, of other feet, or at first without a reading of the primary
            IMU; or one by which the robot stands on its head, as with an IMU that says -g.
        """
        if not isinstance(measurement, Measurement) or measurement.positions.shape != self._shape:
            raise InvalidInputError(
                f"estimator: expected a Measurement of {self._shape[0]} joints,"
                f" got {shown(measurement)}"
            )
        last = self._last
        if last is None or measurement.time > last.time:
            return self._process(measurement)
        return self._process_late(last, measurement)

    def _process_late(self, last: Estimate, late: Measurement) -> Estimate | None:
        """Process a message that is not the latest."""
        times = [one.time for one, _ in self._history]
        index = bisect_left(times, late.time)
        age = 1e3 * (last.time - late.time)
        if index < len(times) and times[index] == late.time:
            return replace(last, notes=("a message came twice; dropped",))
        if index == 0:
            reason = f"older than the last {len(times)} messages"
            self._dropped += 1
            if self._dropped == OLD_MESSAGES_WARNING:
                logging.getLogger(__name__).warning(
                    "estimator: %d messages in a row are older than %g s; dropped, and so are all"
                    " until then: if the clock jumped back, reset() the estimator, or add %.3f s",
                    *(self._dropped, last.time, last.time - late.time),
                )
            return replace(last, notes=(f"a message is {age:.1f} ms late, {reason}; dropped",))
        self._load_shares(late)  # first: a message that is refused leaves all as it was
        messages = [late, *(one for one, _ in list(self._history)[index:])]
        self.core.restore(self._history[index][1])
        for _ in range(len(times) - index):
            self._history.pop()
        for one in messages:
            estimate = self._process(one)
        if estimate is None:  # not after the initialisation
            return None
        note = f"a message is {age:.1f} ms late; {len(messages) - 1} were taken in again"
        return replace(estimate, notes=(*estimate.notes, note))

    def _process(self, m: Measurement) -> Estimate | None:
        core, sample, present = self.core, self._sample, self._imu_present
        sample.loads = self._load_shares(m)  # first, likewise
        self._dropped = 0
        if self._last is not None and self.settings.history:
            self._history.append((m, core.memory()))
        present[:] = 0
        for reading in m.imus:
            index = self._imu_index.get(reading.name)
            if index is not None:
                row = self._imu_rows[index]
                row[:3], row[3:] = reading.angular_velocity, reading.specific_force
                present[index] = 1
        sample.time = m.time
        # The message keeps these arrays for as long as the core reads them.
        sample.positions = doubles(m.positions)
        sample.velocities = ffi.NULL if m.velocities is None else doubles(m.velocities)
        torques = self._joint_torques(m)
        sample.torques = ffi.NULL if torques is None else doubles(torques)
        out = np.empty(core.out)
        status = lib.wbc_estimator_update(core.struct, sample, doubles(out))
        if status == lib.STANDING:
            self._start.add(m)
            return None
        if status != lib.DONE:
            raise InvalidInputError(self._failure(status))
        estimate = self._estimate(m, out)
        if self._last is None:
            try:
                self._start.check(m, estimate)
            except InvalidInputError:
                lib.wbc_estimator_reset(core.struct)
                raise
        self._last = estimate
        return estimate

    def _joint_torques(self, m: Measurement) -> Array | None:
        """Return what motors and springs give (n,); None: not measured."""
        robot = self.robot
        if m.torques is None or not (robot.passive or robot.closure.binds):
            return m.torques
        q, v = robot.postures[NEUTRAL].copy(), np.zeros(robot.nv)
        robot.limits.write_positions(q, m.positions)
        if m.velocities is not None:
            v[BASE_NV:] = m.velocities
        return self.core.observer.joint_torques(q, v, m.torques)

    def _load_shares(self, m: Measurement) -> Any:
        """Return the pointer to the feet's loads, in units of the weight."""
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
        first, wrenches = lib.FEET_STAND, out[lib.OUT_WRENCHES : lib.OUT_WRENCHES + 6 * count]
        forces = {}
        if m.torques is not None:
            forces = {name: wrenches[6 * k : 6 * k + 6] for k, name in enumerate(self._feet)}
        standing = tuple(compress(self._feet, numbers[first : first + count]))
        self._stood_at = m.time if standing or self._last is None else self._stood_at
        return Estimate(
            m.time,
            out[-nq:],
            out[-nq - nv : -nq],
            out[: lib.OUT_GYRO].reshape(STATE_SIZE, STATE_SIZE),
            standing,
            tuple(compress(self._feet, numbers[first + count : first + 2 * count])),
            out[lib.OUT_GYRO : lib.OUT_ACCEL],
            out[lib.OUT_ACCEL : lib.OUT_SQUARED],
            forces,
            (float(out[lib.OUT_SQUARED]), numbers[lib.NIS_ROWS]),
            (*self._notes(), *self._notes_of_flight(m.time - self._stood_at)),
        )

    def _notes(self) -> tuple[str, ...]:
        return notes_of(self.core, *self._names) if self.core.event[0] else ()

    def _notes_of_flight(self, duration: float) -> tuple[str, ...]:
        """Return a note where no foot has stood for longer than a flight takes [s]."""
        if duration <= MAX_FLIGHT:
            return ()
        return (f"no foot has stood for {duration:.0f} s: the IMU alone tells; are loads in N?",)

    def _failure(self, status: int) -> str:
        """Return why there is no estimate, in words."""
        if status == lib.NO_IMU:
            leader = self.imus[self.core.counts[lib.LEADER]].name
            notes = "".join(f"; {note}" for note in self._notes())
            return f"estimator: the first message has no usable reading of IMU {leader!r}{notes}"
        if status == lib.NO_GRAVITY:
            gravity = np.linalg.norm(self.robot.model.gravity.linear)
            return (
                f"estimator: a robot at rest feels {gravity:.2f} m/s^2, the IMU says"
                f" {self.core.detail[0]:.2f}: are its units g, or is it falling?"
            )
        if status == lib.NOT_FINITE:
            return (
                "filter: the innovation of a foot has no positive covariance"
                f"{self._start.interval_note}"
            )
        return "estimator: the estimate is not finite; reset it"


def _doubt_units(imus: Sequence[ImuMount], settings: EstimatorSettings) -> None:
    """Warn of mounts in mm and of a delay in ms: the estimate would be metres off, in silence."""
    logger = logging.getLogger(__name__)
    for imu in imus:
        distance = float(np.linalg.norm(imu.mount.position))
        if distance > FAR_MOUNT:
            logger.warning(
                "estimator: IMU %r is mounted %.3g m from %r; is its position in m?",
                *(imu.name, distance, imu.frame),
            )
    late = settings.encoder_delay
    doubt_delay(f"estimator: encoders are {late:g} s late (encoder_delay)", late)
