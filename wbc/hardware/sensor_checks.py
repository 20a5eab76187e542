"""Plausibility checks of readings: order, age, range, and consistency of sensors."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wbc.hardware.bus import RESTART_GAP, ROWS, Reading, rows_of
from wbc.hardware.safety import Fault, nearest_turn
from wbc.robot import Robot
from wbc.robot.model import check_robot
from wbc.rotations import rotation_from
from wbc.validate import Array

MAX_AGE = 0.010  # s of a usable reading, relative to the freshest so far
CLOCK_JUMP = 0.050  # s
CLOCK_AGREEMENT = 5  # number of readings with a new clock offset that establish it
MAX_OVERRUN = 0.5  # rad or m out of a joint's range that is plausible
MAX_SPEED_RATIO = 3.0  # of a plausible velocity by the limit
MAX_GYROSCOPE, MAX_ACCELEROMETER = 40.0, 400.0  # rad/s, m/s^2: beyond the ranges of IMUs
NORM_TOLERANCE = 0.05  # of the quaternion, from 1
POSITION_JUMP = 0.03  # rad or m between two readings, above the motion at the velocity limits
WINDOW = 0.020  # s over which sensors are compared
FROZEN_TIME = 0.020  # s without a changed bit of an IMU's sensor: real ones have noise
# Tolerance of position against velocity of a joint: offset [rad/s], and ratio of the rate.
RATE_OFFSET, RATE_RATIO = 0.7, 0.4
GYRO_TOLERANCE, GYRO_RATIO = 1.0, 0.4  # likewise of orientation against gyroscope
GRAVITY_ANGLE = 0.8  # rad between accelerometer and orientation
GRAVITY_TIME = 0.3  # s: time constant of the mean specific force
MIN_GRAVITY, MAX_GRAVITY = 4.0, 20.0  # m/s^2 of that mean, except in falls and landings
MAX_FALL_TIME = 1.0  # s: 5 m
TORQUE_TOLERANCE = 0.5  # by the effort limit
MIN_TEMPERATURE, MAX_TEMPERATURE = -30.0, 150.0  # degrees C of a plausible thermometer


class SensorFinding(NamedTuple):
    """A fault that a reading shows."""

    fault: Fault
    detail: str = ""


class SensorChecks:
    """Checks each reading of a robot, also against the ones before.

    Attributes
    ----------
    jumped_back:
        Total by which the robot's clock jumped back [s]; see :meth:`mended`.
    """

    def __init__(self, robot: Robot) -> None:
        check_robot("sensor checks", robot)
        limits, self._names = robot.limits, robot.joint_names
        self._lower, self._upper = limits.lower, limits.upper
        self._velocity, self._effort = limits.velocity, limits.effort
        self._endless = np.isinf(limits.lower) & np.isinf(limits.upper)
        self._window = deque[Reading]()  # usable ones
        self._velocities, self._gyroscopes = np.zeros(len(self._names)), np.zeros(3)  # their sums
        self._offset: float | None = None  # of our clock from the robot's, smallest
        self._last_offset = 0.0
        self.jumped_back = 0.0
        self._new_offsets = deque[float](maxlen=CLOCK_AGREEMENT)
        self._last_change = [0.0, 0.0]  # of gyroscope and accelerometer [s]
        self._gravity: Array = np.array((0.0, 0.0, 9.81))  # mean specific force, world axes
        self._last_gravity_time = 0.0  # with a plausible norm of that [s]
        self._sequence = -1

    def look_at(
        self, reading: Reading, now: float, commanded: Array | None = None
    ) -> tuple[bool, tuple[SensorFinding, ...]]:
        """Return whether a reading is usable, and the findings.

        It calls :meth:`mended`, :meth:`refused` and :meth:`compared`.
        """
        reading = self.mended(reading)
        refused = self.refused(reading, now)
        if refused is not None:
            return False, (refused,)
        return True, self.compared(reading, commanded)

    def mended(self, reading: Reading) -> Reading:
        """Return the reading with its time corrected for jumps of the robot's clock.

        Estimator and controller use these times: after a jump back they would take all readings for
        late, after one ahead they would predict over seconds that never passed.
        """
        jump = self.jumped_back
        return replace(reading, time=reading.time + jump) if jump else reading

    def refused(self, reading: Reading, now: float) -> SensorFinding | None:
        """Return why a :meth:`mended` reading is not usable; None if it is.

        Parameters
        ----------
        now:
            Time at which it was taken from the bus [s].
        """
        finding = self._unusable(reading, now)
        if finding is None:
            self._sequence = reading.sequence
        return finding

    def compared(
        self, reading: Reading, commanded: Array | None = None
    ) -> tuple[SensorFinding, ...]:
        """Return the findings of a usable reading: inconsistent or frozen sensors.

        Parameters
        ----------
        commanded:
            Expected torques (n,); None: unknown.
        """
        self._velocities = self._velocities + reading.velocity
        self._gyroscopes = self._gyroscopes + reading.angular_velocity
        found = [*self._compare_sensors(reading), *self._check_frozen(reading)]
        found += self._check_torques(reading, commanded)
        self._window.append(reading)
        while reading.time - self._window[0].time > WINDOW + 1e-9:
            old = self._window.popleft()
            self._velocities = self._velocities - old.velocity
            self._gyroscopes = self._gyroscopes - old.angular_velocity
        return tuple(found)

    def _clear_window(self) -> None:
        self._window.clear()
        self._velocities, self._gyroscopes = np.zeros(len(self._lower)), np.zeros(3)

    # ------------------------------------------------------------------ unusable readings

    def _unusable(self, reading: Reading, now: float) -> SensorFinding | None:
        r = reading
        # A restarted sender's numbers are far lower, which no late message's are.
        if self._sequence - RESTART_GAP <= r.sequence <= self._sequence:
            return SensorFinding(Fault.OUT_OF_ORDER, f"number {r.sequence} after {self._sequence}")
        joints = rows_of(len(self._names), r.position, r.velocity, r.torque, r.temperature)
        turns, imu = rows_of(4, r.quaternion), rows_of(3, r.angular_velocity, r.specific_force)
        if joints is None or turns is None or imu is None:
            what = f"not of {len(self._names)} joints" if joints is None else "IMU"
            return SensorFinding(Fault.NOT_FINITE, what)
        others = [*turns.flat, *imu.flat, r.time, r.sequence]
        if not (np.isfinite(joints).all() and np.isfinite(others).all()):
            names, rows = (*ROWS, "time", "sequence"), (*joints, turns, *imu, *others[-2:])
            wrong = [
                name for name, row in zip(names, rows, strict=True) if not np.isfinite(row).all()
            ]
            return SensorFinding(Fault.NOT_FINITE, ", ".join(wrong))
        return self._check_time(r.time, now) or self._check_range(r) or self._check_jump(r)

    def _check_time(self, time: float, now: float) -> SensorFinding | None:
        offset = now - time
        if self._offset is None:
            self._offset = self._last_offset = offset
        age = offset - self._offset
        if abs(age) <= MAX_AGE:
            # The smallest offset of two readings so far, since one time may be wrong, is that of no
            # delay; it adapts by 1e-4 to clock drift.
            fresh, self._last_offset = max(offset, self._last_offset), offset
            self._offset = min(fresh, self._offset + 1e-4 * max(age, 0.0))
            self._new_offsets.clear()
            return None
        self._new_offsets.append(offset)
        spread = max(self._new_offsets) - min(self._new_offsets)
        jumped = age > CLOCK_JUMP or age < 0.0  # what is late by less may be delayed for long
        if len(self._new_offsets) == CLOCK_AGREEMENT and spread < MAX_AGE and jumped:
            self.jumped_back += min(self._new_offsets) - self._offset
            self._new_offsets.clear()
            return SensorFinding(Fault.CLOCK_JUMPED, f"by {-age:.3f} s; taken as it is now")
        if jumped:
            return SensorFinding(Fault.CLOCK_JUMPED, f"by {-age:.3f} s")
        return SensorFinding(Fault.OLD_READING, f"by {1e3 * age:.0f} ms")

    def _check_range(self, r: Reading) -> SensorFinding | None:
        overrun = np.maximum(r.position - self._upper, self._lower - r.position)
        if overrun.max() > MAX_OVERRUN:
            return SensorFinding(Fault.IMPLAUSIBLE, f"position of {self._names[overrun.argmax()]}")
        faster = np.abs(r.velocity) - MAX_SPEED_RATIO * self._velocity
        if faster.max() > 0.0:
            return SensorFinding(Fault.IMPLAUSIBLE, f"velocity of {self._names[faster.argmax()]}")
        if r.temperature.min() < MIN_TEMPERATURE or r.temperature.max() > MAX_TEMPERATURE:
            return SensorFinding(Fault.IMPLAUSIBLE, "temperature")
        if abs(np.linalg.norm(r.quaternion) - 1.0) > NORM_TOLERANCE:
            return SensorFinding(Fault.IMPLAUSIBLE, "orientation is no rotation")
        if np.abs(r.angular_velocity).max() > MAX_GYROSCOPE:
            return SensorFinding(Fault.IMPLAUSIBLE, "angular velocity")
        if np.abs(r.specific_force).max() > MAX_ACCELEROMETER:
            return SensorFinding(Fault.IMPLAUSIBLE, "specific force")
        return None

    def _check_jump(self, r: Reading) -> SensorFinding | None:
        if not self._window:
            return None
        last = self._window[-1]
        elapsed = max(r.time - last.time, 0.0)
        if elapsed > WINDOW:  # too long ago to compare
            self._clear_window()
            return None
        # 5 rad/s beyond the measured velocity: the limits alone allow 0.06 rad.
        reach = POSITION_JUMP + elapsed * np.minimum(self._velocity, np.abs(last.velocity) + 5.0)
        excess = np.abs(self._motion(last, r)) - reach
        if excess.max() > 0.0:
            return SensorFinding(Fault.JUMPED, self._names[excess.argmax()])
        angle = 2.0 * np.arccos(min(abs(float(r.quaternion @ last.quaternion)), 1.0))
        if angle > 2.0 * POSITION_JUMP + elapsed * (np.linalg.norm(last.angular_velocity) + 10.0):
            return SensorFinding(Fault.JUMPED, "orientation")
        return None

    def _motion(self, before: Reading, now: Reading) -> Array:
        """Return how far joints moved (n,)."""
        return nearest_turn(now.position, before.position, self._endless) - before.position

    # ------------------------------------------------------------------ inconsistent sensors

    def _compare_sensors(self, r: Reading) -> list[SensorFinding]:
        found = list[SensorFinding]()
        if self._window and r.time - self._window[0].time >= 0.8 * WINDOW:
            first, elapsed = self._window[0], r.time - self._window[0].time
            rate = self._motion(first, r) / elapsed
            count = len(self._window) + 1
            mean = self._velocities / count
            off = np.abs(rate - mean) - RATE_OFFSET - RATE_RATIO * np.maximum(abs(rate), abs(mean))
            if off.max() > 0.0:
                found.append(SensorFinding(Fault.ENCODER_DISAGREES, self._names[off.argmax()]))
            R = rotation_from(first.quaternion).T @ rotation_from(r.quaternion)
            rate_of_turn = (
                0.5 * np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])) / elapsed
            )
            gyroscope = self._gyroscopes / count
            larger = max(np.linalg.norm(rate_of_turn), np.linalg.norm(gyroscope))
            if np.linalg.norm(rate_of_turn - gyroscope) > GYRO_TOLERANCE + GYRO_RATIO * larger:
                found.append(SensorFinding(Fault.IMU_DISAGREES))
        found += self._check_gravity(r)
        return found

    def _check_gravity(self, r: Reading) -> list[SensorFinding]:
        force = rotation_from(r.quaternion) @ r.specific_force
        elapsed = max(r.time - self._window[-1].time, 0.0) if self._window else 0.0
        self._gravity = self._gravity + min(elapsed / GRAVITY_TIME, 1.0) * (force - self._gravity)
        norm = float(np.linalg.norm(self._gravity))
        if MIN_GRAVITY <= norm <= MAX_GRAVITY or not self._window:
            self._last_gravity_time = r.time
        elif r.time - self._last_gravity_time > MAX_FALL_TIME:
            detail = f"{norm:.1f} m/s^2 on average, for too long to be a fall; another unit?"
            return [SensorFinding(Fault.GRAVITY_DISAGREES, detail)]
        if norm >= MIN_GRAVITY and self._gravity[2] < norm * np.cos(GRAVITY_ANGLE):
            return [SensorFinding(Fault.GRAVITY_DISAGREES)]
        return []

    def _check_frozen(self, r: Reading) -> list[SensorFinding]:
        last = self._window[-1] if self._window else None
        rows = (("gyroscope", "angular_velocity"), ("accelerometer", "specific_force"))
        found = list[SensorFinding]()
        for k, (name, row) in enumerate(rows):
            if last is None or not np.array_equal(getattr(last, row), getattr(r, row)):
                self._last_change[k] = r.time
            elif r.time - self._last_change[k] > FROZEN_TIME:
                found.append(SensorFinding(Fault.IMU_FROZEN, name))
        return found

    def _check_torques(self, r: Reading, commanded: Array | None) -> list[SensorFinding]:
        if commanded is None:
            return []
        excess = np.abs(r.torque - commanded) - TORQUE_TOLERANCE * self._effort
        k = excess.argmax()
        return [SensorFinding(Fault.TORQUE_DISAGREES, self._names[k])] if excess[k] > 0.0 else []
