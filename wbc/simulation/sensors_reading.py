"""Simulates the robot's devices: from states of the plant to messages."""

from __future__ import annotations

import heapq
from collections import deque

import numpy as np

from wbc.estimation.measurement import ImuReading, Measurement
from wbc.robot.limits import BASE_NV
from wbc.robot.mounted_frames import MountedFrames
from wbc.rotations import exp_rotation, log_rotation, rotation_from
from wbc.simulation.plant import Plant
from wbc.simulation.sensors_devices import Devices, Imu
from wbc.validate import Array

RAMP = 0.05  # rad/s or m/s: of the ramp of dry friction through zero


class _ImuState:
    """One IMU from one reset to the next."""

    def __init__(self, imu: Imu, period: float, random: np.random.Generator) -> None:
        self.imu, self.period = imu, period
        self._random = random
        self._noise = np.repeat((imu.gyroscope_noise, imu.accelerometer_noise), 3)
        self._walk = np.repeat((imu.gyroscope_walk, imu.accelerometer_walk), 3)
        bias = np.repeat((imu.gyroscope_bias, imu.accelerometer_bias), 3)
        self.bias: Array = bias * random.normal(size=6)
        self._range = np.repeat((imu.most_rate, imu.most_force), 3)
        self.last: tuple[float, Array, Array] | None = None  # time, rotation, velocity

    def read(self, time: float, R: Array, velocity: Array, gravity: Array) -> ImuReading | None:
        """Return a reading if one is due: the means since the last one, from both end states."""
        if self.last is None:
            self.last = time, R, velocity
            return None
        last_time, last_rotation, last_velocity = self.last
        dt = time - last_time
        if dt < self.period - 1e-9:
            return None
        self.last = time, R, velocity
        turn = log_rotation(last_rotation.T @ R)
        mean_rotation = last_rotation @ exp_rotation(0.5 * turn)
        force = mean_rotation.T @ ((velocity - last_velocity) / dt - gravity)
        white = self._random.normal(size=(2, 6))
        self.bias = self.bias + self._walk * np.sqrt(dt) * white[0]
        both = np.concatenate((turn / dt, force)) + self.bias + self._noise / np.sqrt(dt) * white[1]
        both = np.clip(both, -self._range, self._range)
        return ImuReading(self.imu.name, both[:3], both[3:])


class Sensing:
    """Reads devices once per control period, from one reset of the plant to the next.

    ``lost``: number of lost messages.
    """

    def __init__(self, plant: Plant, devices: Devices) -> None:
        robot = plant.robot
        self._robot, self._devices = robot, devices
        self._random = random = np.random.default_rng((devices.seed, 20261126))
        self._imus = [_ImuState(one, one.period(plant.dt), random) for one in devices.imus]
        mounts = [one.mount.mount for one in devices.imus]
        self._mounted = MountedFrames(robot, mounts)
        joints = robot.nv - BASE_NV
        torques = devices.torques
        self._gain = 1.0 + (torques.gain if torques else 0.0) * random.normal(size=joints)
        effort = robot.limits.effort
        self._friction = np.where(np.isfinite(effort), effort, 0.0)
        self._past: deque[tuple[float, Array, Array]] = deque()
        self._sent: list[tuple[float, int, Measurement]] = []
        self._count = self.lost = 0
        self._gravity = np.array(plant.model.opt.gravity)

    @property
    def biases(self) -> tuple[Array, ...]:
        """True biases (6,) of the IMUs: gyroscope [rad/s], accelerometer [m/s^2]."""
        return tuple(one.bias.copy() for one in self._imus)

    def read(self, plant: Plant, time: float | None = None) -> None:
        """Measure the plant and send a message; ``time``, if not the plant's own [s]."""
        time = plant.time if time is None else time
        q, v = plant.state()
        m, bus = self._measured(plant, time, q, v), self._devices.bus
        lost, late = self._random.uniform(size=2)
        if lost < bus.loss:
            self.lost += 1
            return
        self._count += 1
        heapq.heappush(self._sent, (time + bus.delay + late * bus.jitter, self._count, m))

    def received(self, time: float) -> list[Measurement]:
        """Return the messages that arrived until ``time`` [s], in order of arrival."""
        messages = []
        while self._sent and self._sent[0][0] <= time + 1e-9:
            messages.append(heapq.heappop(self._sent)[2])
        return messages

    def _measured(self, plant: Plant, time: float, q: Array, v: Array) -> Measurement:
        devices, random, joints = self._devices, self._random, self._robot.nv - BASE_NV
        positions, rates = self._robot.limits.joint_positions(q), v[BASE_NV:]
        readings = self._inertial(time, q, v, positions)
        seen, rates_seen = self._delayed(time, positions, rates)
        encoders, white = devices.encoders, random.normal(size=(3, joints))
        seen = seen + encoders.noise * white[0]
        if encoders.resolution:
            seen = encoders.resolution * np.round(seen / encoders.resolution)
        torque = None
        if devices.torques is not None:
            acting = plant.states.torques_from_mujoco(plant.data.qfrc_applied)  # after a latency
            torque = self._gain * acting + devices.torques.noise * white[1]
            torque += devices.torques.friction * self._friction * np.clip(rates / RAMP, -1.0, 1.0)
        pressed = None
        if devices.feet is not None:
            found = plant.contacts
            pressed = {name: found.load(name) > devices.feet.force for name in self._robot.feet}
        return Measurement(
            time,
            seen,
            rates_seen + encoders.rate_noise * white[2] if encoders.rates else None,
            torque,
            readings,
            pressed,
        )

    def _inertial(
        self, time: float, q: Array, v: Array, positions: Array
    ) -> tuple[ImuReading, ...]:
        mounted, R = self._mounted, rotation_from(q[3:7])
        mounted.update(positions)
        readings = []
        for k, imu in enumerate(self._imus):
            velocity = v[:3] + np.cross(v[3:6], mounted.origin(k))
            velocity += mounted.jacobian(k)[:3, BASE_NV:] @ v[BASE_NV:]
            reading = imu.read(time, R @ mounted.rotation(k), R @ velocity, self._gravity)
            if reading is not None:
                readings.append(reading)
        return tuple(readings)

    def _delayed(self, time: float, positions: Array, rates: Array) -> tuple[Array, Array]:
        """Return positions and rates ``delay`` ago, interpolated between periods."""
        delay = self._devices.encoders.delay
        if not delay:
            return positions, rates
        past, time_read = self._past, time - delay
        past.append((time, positions.copy(), rates.copy()))
        while len(past) > 1 and past[1][0] <= time_read + 1e-12:
            past.popleft()
        (t, p, r), *rest = past
        if time_read <= t or not rest:
            return p, r
        share = (time_read - t) / (rest[0][0] - t)
        moved, around = rest[0][1] - p, list(self._robot.limits.unbounded)
        moved[around] -= 2.0 * np.pi * np.round(moved[around] / (2.0 * np.pi))
        return p + share * moved, r + share * (rest[0][2] - r)
