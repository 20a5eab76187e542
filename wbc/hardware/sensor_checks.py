"""Whether readings can be believed: order, age, range, and sensors against each other."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wbc.hardware.bus import RESTARTED, Reading, rows_of
from wbc.hardware.safety import Fault
from wbc.robot import Robot
from wbc.robot.model import check_robot
from wbc.rotations import rotation_from
from wbc.validate import Array

OLDEST = 0.010  # s: readings that are older than the freshest were by more are no use
CLOCK_JUMP = 0.050  # s
AGREE_AGAIN = 5  # readings that agree on a new clock make it the clock
FARTHEST = 0.5  # rad or m out of a joint's range: no joint can be there
FASTEST = 3.0  # times the velocity limit
FASTEST_TURN, HARDEST = 40.0, 400.0  # rad/s, m/s^2: beyond the ranges of IMUs
NORM = 0.05  # of the quaternion, off 1
JUMP = 0.03  # rad or m between two readings, above what the velocity limits allow
WINDOW = 0.020  # s over which sensors are compared
FROZEN = 0.020  # s without a bit of an IMU's sensor changing: real ones have noise
RATE_OFF, RATE_PART = 0.7, 0.4  # rad/s, and part of the rate, that rates of one joint may differ
TURN_OFF, TURN_PART = 1.0, 0.4  # as much of the IMU
GRAVITY_OFF = 0.8  # rad
GRAVITY_TIME = 0.3  # s over which the specific force is averaged
WEAKEST, STRONGEST = 4.0, 20.0  # m/s^2 of that average, but while it falls or lands
LONGEST_FALL = 1.0  # s: 5 m
TORQUE_OFF = 0.5  # of the effort limit
COLDEST, HOTTEST = -30.0, 150.0  # degrees C that a thermometer can mean


class SensorFinding(NamedTuple):
    """A fault that a reading shows."""

    fault: Fault
    detail: str = ""


class SensorChecks:
    """Looks at each reading of a robot; keeps what it compares with.

    Attributes
    ----------
    jumped_back:
        By how much the robot's clock jumped back, in sum [s]; see :meth:`mended`.
    """

    def __init__(self, robot: Robot) -> None:
        check_robot("sensor checks", robot)
        limits, self._names = robot.limits, robot.joint_names
        self._lower, self._upper = limits.lower, limits.upper
        self._velocity, self._effort = limits.velocity, limits.effort
        self._past = deque[Reading]()  # usable ones of the last WINDOW
        self._velocities, self._spins = np.zeros(len(self._names)), np.zeros(3)  # their sums
        self._offset: float | None = None  # of the robot's clock from ours, at its freshest
        self.jumped_back = 0.0
        self._strange = deque[float](maxlen=AGREE_AGAIN)
        self._changed = [0.0, 0.0]  # when a bit of gyroscope and accelerometer last did
        self._gravity: Array = np.array((0.0, 0.0, 9.81))  # mean specific force, world axes
        self._weighed = 0.0  # when that was last what a robot weighs [s of its clock]
        self._sequence = -1

    def look_at(
        self, reading: Reading, now: float, commanded: Array | None = None
    ) -> tuple[bool, tuple[SensorFinding, ...]]:
        """Return whether a reading is of use, and what is wrong with it or shown by it.

        It is :meth:`refused` and :meth:`compared`, one after the other.
        """
        reading = self.mended(reading)
        refused = self.refused(reading, now)
        if refused is not None:
            return False, (refused,)
        return True, self.compared(reading, commanded)

    def mended(self, reading: Reading) -> Reading:
        """Return a reading whose time goes on where the robot's clock jumped.

        What estimates and leads goes by these times: after a jump back it would take all that comes
        for late, after one ahead it would predict over seconds that never were.
        """
        back = self.jumped_back
        return replace(reading, time=reading.time + back) if back else reading

    def refused(self, reading: Reading, now: float) -> SensorFinding | None:
        """Return why a :meth:`mended` reading is of no use; None: it is.

        Parameters
        ----------
        now:
            When it was taken from the bus [s].
        """
        found = self._unusable(reading, now)
        if found is None:
            self._sequence = reading.sequence
        return found

    def compared(
        self, reading: Reading, commanded: Array | None = None
    ) -> tuple[SensorFinding, ...]:
        """Return what a reading of use shows: sensors that contradict each other, or are frozen.

        Parameters
        ----------
        commanded:
            Torques (n,) that motors should have now; None: not known.
        """
        self._velocities = self._velocities + reading.velocity
        self._spins = self._spins + reading.angular_velocity
        found = [*self._comparisons(reading), *self._frozen(reading)]
        found += self._torques(reading, commanded)
        self._past.append(reading)
        while reading.time - self._past[0].time > WINDOW + 1e-9:
            old = self._past.popleft()
            self._velocities = self._velocities - old.velocity
            self._spins = self._spins - old.angular_velocity
        return tuple(found)

    def _forget(self) -> None:
        self._past.clear()
        self._velocities, self._spins = np.zeros(len(self._lower)), np.zeros(3)

    # ------------------------------------------------------------------ readings of no use

    def _unusable(self, reading: Reading, now: float) -> SensorFinding | None:
        r = reading
        # One that counts anew is far back, so no message that came late.
        if self._sequence - RESTARTED <= r.sequence <= self._sequence:
            return SensorFinding(Fault.OUT_OF_ORDER, f"number {r.sequence} after {self._sequence}")
        joints = rows_of(len(self._names), r.position, r.velocity, r.torque, r.temperature)
        turns, imu = rows_of(4, r.quaternion), rows_of(3, r.angular_velocity, r.specific_force)
        if joints is None or turns is None or imu is None:
            what = f"not of {len(self._names)} joints" if joints is None else "IMU"
            return SensorFinding(Fault.NOT_FINITE, what)
        if not (np.isfinite(joints).all() and np.isfinite([*turns.flat, *imu.flat, r.time]).all()):
            rows = ("position", "velocity", "torque", "temperature")
            bad = [
                name for name, row in zip(rows, joints, strict=True) if not np.isfinite(row).all()
            ]
            return SensorFinding(Fault.NOT_FINITE, ", ".join(bad) or "IMU or time")
        return self._timely(r.time, now) or self._possible(r) or self._jumped(r)

    def _timely(self, time: float, now: float) -> SensorFinding | None:
        offset = now - time
        if self._offset is None:
            self._offset = offset
        age = offset - self._offset
        if -CLOCK_JUMP < age <= OLDEST:
            # The freshest reading so far is new; 1e-4 of it is forgotten, for clocks that drift.
            self._offset = min(offset, self._offset + 1e-4 * max(age, 0.0))
            self._strange.clear()
            return None
        self._strange.append(offset)
        spread = max(self._strange) - min(self._strange)
        if len(self._strange) == AGREE_AGAIN and spread < OLDEST and abs(age) > CLOCK_JUMP:
            self.jumped_back += min(self._strange) - self._offset
            self._strange.clear()
            return SensorFinding(Fault.CLOCK_JUMPED, f"by {-age:.3f} s; taken as it is now")
        if age > CLOCK_JUMP or age < 0.0:
            return SensorFinding(Fault.CLOCK_JUMPED, f"by {-age:.3f} s")
        return SensorFinding(Fault.OLD_READING, f"by {1e3 * age:.0f} ms")

    def _possible(self, r: Reading) -> SensorFinding | None:
        beyond = np.maximum(r.position - self._upper, self._lower - r.position)
        if beyond.max() > FARTHEST:
            return SensorFinding(Fault.IMPLAUSIBLE, f"position of {self._names[beyond.argmax()]}")
        faster = np.abs(r.velocity) - FASTEST * self._velocity
        if faster.max() > 0.0:
            return SensorFinding(Fault.IMPLAUSIBLE, f"velocity of {self._names[faster.argmax()]}")
        if r.temperature.min() < COLDEST or r.temperature.max() > HOTTEST:
            return SensorFinding(Fault.IMPLAUSIBLE, "temperature")
        if abs(np.linalg.norm(r.quaternion) - 1.0) > NORM:
            return SensorFinding(Fault.IMPLAUSIBLE, "orientation is no rotation")
        if np.abs(r.angular_velocity).max() > FASTEST_TURN:
            return SensorFinding(Fault.IMPLAUSIBLE, "angular velocity")
        if np.abs(r.specific_force).max() > HARDEST:
            return SensorFinding(Fault.IMPLAUSIBLE, "specific force")
        return None

    def _jumped(self, r: Reading) -> SensorFinding | None:
        if not self._past:
            return None
        last = self._past[-1]
        passed = max(r.time - last.time, 0.0)
        if passed > WINDOW:  # too long ago to tell
            self._forget()
            return None
        # Half of the velocity limit beyond what was measured: the limits alone allow 0.06 rad.
        reach = JUMP + passed * np.minimum(self._velocity, np.abs(last.velocity) + 5.0)
        over = np.abs(r.position - last.position) - reach
        if over.max() > 0.0:
            return SensorFinding(Fault.JUMPED, self._names[over.argmax()])
        turn = 2.0 * np.arccos(min(abs(float(r.quaternion @ last.quaternion)), 1.0))
        if turn > 2.0 * JUMP + passed * (np.linalg.norm(last.angular_velocity) + 10.0):
            return SensorFinding(Fault.JUMPED, "orientation")
        return None

    # ------------------------------------------------------------------ sensors that contradict

    def _comparisons(self, r: Reading) -> list[SensorFinding]:
        found = list[SensorFinding]()
        if self._past and r.time - self._past[0].time >= 0.8 * WINDOW:
            first, passed = self._past[0], r.time - self._past[0].time
            rate = (r.position - first.position) / passed
            count = len(self._past) + 1
            told = self._velocities / count
            off = np.abs(rate - told) - RATE_OFF - RATE_PART * np.maximum(abs(rate), abs(told))
            if off.max() > 0.0:
                found.append(SensorFinding(Fault.ENCODER_DISAGREES, self._names[off.argmax()]))
            R = rotation_from(first.quaternion).T @ rotation_from(r.quaternion)
            turn = (
                0.5 * np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])) / passed
            )
            spun = self._spins / count
            larger = max(np.linalg.norm(turn), np.linalg.norm(spun))
            if np.linalg.norm(turn - spun) > TURN_OFF + TURN_PART * larger:
                found.append(SensorFinding(Fault.IMU_DISAGREES))
        found += self._leaning(r)
        return found

    def _leaning(self, r: Reading) -> list[SensorFinding]:
        force = rotation_from(r.quaternion) @ r.specific_force
        passed = r.time - self._past[-1].time if self._past else 0.0
        self._gravity = self._gravity + min(passed / GRAVITY_TIME, 1.0) * (force - self._gravity)
        size = float(np.linalg.norm(self._gravity))
        if WEAKEST <= size <= STRONGEST or not self._past:
            self._weighed = r.time
        elif r.time - self._weighed > LONGEST_FALL:
            detail = f"{size:.1f} m/s^2 on average, for too long to be a fall; another unit?"
            return [SensorFinding(Fault.GRAVITY_DISAGREES, detail)]
        if size >= WEAKEST and self._gravity[2] < size * np.cos(GRAVITY_OFF):
            return [SensorFinding(Fault.GRAVITY_DISAGREES)]
        return []

    def _frozen(self, r: Reading) -> list[SensorFinding]:
        last = self._past[-1] if self._past else None
        now = (r.angular_velocity, r.specific_force)
        before = now if last is None else (last.angular_velocity, last.specific_force)
        found = list[SensorFinding]()
        for k, name in enumerate(("gyroscope", "accelerometer")):
            if last is None or not np.array_equal(before[k], now[k]):
                self._changed[k] = r.time
            elif r.time - self._changed[k] > FROZEN:
                found.append(SensorFinding(Fault.IMU_FROZEN, name))
        return found

    def _torques(self, r: Reading, commanded: Array | None) -> list[SensorFinding]:
        if commanded is None:
            return []
        off = np.abs(r.torque - commanded) - TORQUE_OFF * self._effort
        k = off.argmax()
        return [SensorFinding(Fault.TORQUE_DISAGREES, self._names[k])] if off[k] > 0.0 else []
