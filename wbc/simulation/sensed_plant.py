"""A plant whose state is estimated from the robot's simulated devices."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.estimation import Estimate, EstimatorSettings, StateEstimator
from wbc.estimation.estimate import count_notes, frequent_notes
from wbc.kinds import check_kind
from wbc.robot import Robot
from wbc.rotations import log_rotation, rotation_from
from wbc.simulation.plant import PERFECT, Plant
from wbc.simulation.sensors import Sensors
from wbc.simulation.sensors_devices import Devices
from wbc.simulation.sensors_reading import Sensing
from wbc.validate import Array

MAX_IN_FLIGHT = 64  # age of a message, in control periods, up to which its estimate is compared
EXTRA_PERIODS = 50  # control periods of standing, as messages may be lost and IMUs slow


class EstimateErrors:
    """Errors of the base's estimates over a run, and their consistency with the covariances.

    ``count``: number of estimates.
    ``way``: horizontal distance that the base travelled [m], from its places every quarter of a
    second, so that its sway hardly counts.
    ``drift``, ``yaw``: horizontal error of the position [m] and of the heading [rad] at the last
    estimate.
    ``rise``: error of the base's height at the last estimate [m].
    """

    def __init__(self) -> None:
        self.count = 0
        self.way = self.drift = self.yaw = self.rise = 0.0
        self._squares = np.zeros(5)  # velocity, tilt; normalised: velocity, tilt, and innovation
        self._rows = 0
        self._last_place: tuple[float, Array] | None = None

    def add(self, estimate: Estimate, q: Array, v: Array) -> None:
        """Compare an estimate with the configuration (nq,) and velocity (nv,) of its time."""
        R, estimated = rotation_from(q[3:7]), rotation_from(estimate.q[3:7])
        rotation, P = log_rotation(estimated @ R.T), estimate.covariance
        velocity = estimated @ estimate.v[:3] - R @ v[:3]
        squares = (
            velocity @ velocity,
            rotation[:2] @ rotation[:2],
            velocity @ np.linalg.solve(P[3:6, 3:6], velocity) / 3.0,
            rotation[:2] @ np.linalg.solve(P[:2, :2], rotation[:2]) / 2.0,
            estimate.innovation[0],
        )
        self._squares += np.array(squares, dtype=float)
        self._rows += estimate.innovation[1]
        self.count += 1
        self.drift = math.hypot(*(estimate.q[:2] - q[:2]).tolist())
        self.yaw, self.rise = float(rotation[2]), float(estimate.q[2] - q[2])
        if self._last_place is None or estimate.time - self._last_place[0] >= 0.25:
            if self._last_place is not None:
                self.way += math.hypot(*(q[:2] - self._last_place[1]).tolist())
            self._last_place = estimate.time, q[:2].copy()

    @property
    def velocity(self) -> float:
        """Root mean square error of the linear velocity, its norm [m/s]."""
        return math.sqrt(float(self._squares[0]) / max(self.count, 1))

    @property
    def tilt(self) -> float:
        """Root mean square error of the tilt [rad]."""
        return math.sqrt(float(self._squares[1]) / max(self.count, 1))

    @property
    def normalised(self) -> tuple[float, float]:
        """Mean normalised squares of velocity and tilt per degree of freedom: 1 if consistent.

        Errors of the base, by the covariance of the IMU: it is to be on the base.
        """
        v, tilt = (self._squares[2:4] / max(self.count, 1)).tolist()
        return v, tilt

    @property
    def innovation(self) -> float:
        """Mean normalised innovation squared per row: 1 if the noise is as modelled."""
        return float(self._squares[4]) / max(self._rows, 1)

    def __str__(self) -> str:
        share = f" ({100.0 * self.drift / self.way:.1f} % of the way)" if self.way > 1.0 else ""
        return (
            f"estimated state: velocity off by {self.velocity:.3f} m/s (rms), tilt by"
            f" {math.degrees(self.tilt):.2f} degrees; in the end heading by"
            f" {math.degrees(self.yaw):.1f} degrees, position by {1e3 * self.drift:.0f} mm{share},"
            f" height by {1e3 * self.rise:+.0f} mm"
        )


class SensedPlant(Plant):
    """A :class:`~wbc.simulation.Plant` that is measured by an estimator from its devices.

    :meth:`measure` returns the estimate, predicted over the age of the last message by its
    velocity, and :attr:`felt_forces` the estimated forces on the soles; :meth:`state` and
    :attr:`contact_forces` are still true, for verdicts and comparisons. At the reset it is fixed
    where it stands while the estimator initialises; devices run before time 0.

    Parameters
    ----------
    devices:
        The robot's sensors; by default a common humanoid's.
    settings:
        Of the estimator; by default it knows the encoders' delay.
    others:
        See :class:`~wbc.simulation.Plant`; of ``sensors`` only the latency of torques.

    Attributes
    ----------
    devices, estimator:
        The devices, and their estimator.
    sensing:
        Reads the devices.
    estimate:
        The last one.
    errors:
        Of the estimates so far.
    told:
        Notes of the estimates, without numbers, and their counts.
    """

    _fixed = Plant._fixed | dict.fromkeys(("devices", "estimator"), "make another SensedPlant")

    devices: Devices
    estimator: StateEstimator
    sensing: Sensing
    estimate: Estimate
    errors: EstimateErrors
    told: dict[str, int]

    def __init__(
        self,
        robot: Robot,
        *,
        devices: Devices | None = None,
        settings: EstimatorSettings | None = None,
        dt: float = 0.002,
        **others: Any,
    ) -> None:
        sensors = others.get("sensors", PERFECT)
        check_kind("plant, sensors", sensors, Sensors, "Sensors(latency=0.002)")
        if replace(sensors, latency=0.0, seed=0) != PERFECT:
            raise InvalidInputError(
                "plant, sensors: noise on the true state, which is not measured here; of these give"
                " latency only, and devices"
            )
        check_kind("plant, devices", devices, Devices, "Devices()", or_none=True)
        check_kind("plant, settings", settings, EstimatorSettings, or_none=True)
        self.devices = devices or Devices()
        known = settings or EstimatorSettings(encoder_delay=self.devices.encoders.delay)
        mounts = [one.mount for one in self.devices.imus]
        self.estimator = StateEstimator(robot, mounts, known, dt=dt)
        super().__init__(robot, dt=dt, **others)

    def reset(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Begin at rest at ``q`` (nq,), whose base position and heading the estimator gets.

        Raises
        ------
        InvalidInputError
            An unusable state, or one that moves: a robot stands while its estimator initialises.
        """
        if v is not None and self.robot.check_velocity(v).any():
            raise InvalidInputError(
                "plant, v: a robot whose state is estimated begins at rest; leave it out"
            )
        super().reset(q)
        self._truths = deque[tuple[float, Array, Array]](maxlen=MAX_IN_FLIGHT)
        self.sensing, self.errors = Sensing(self, self.devices), EstimateErrors()
        self.told = {}
        self.estimator.reset(q)
        bus, found = self.devices.bus, None
        settling = self.estimator.settings.standing_time + bus.delay + bus.jitter
        for k in range(-int(np.ceil(settling / self.dt)) - EXTRA_PERIODS, 0):
            self.sensing.read(self, k * self.dt)
            found = self._receive(k * self.dt) or found
        if found is None:
            raise InvalidInputError(
                f"plant, devices: the estimator cannot begin: {self.estimator.kept_by}"
            )
        self.estimate, self._is_read = found, False

    def measure(self) -> tuple[Array, Array]:
        """Return the estimated configuration and velocity.

        All calls within one control period return the same.
        """
        if not self._is_read:
            self.sensing.read(self)
            self._truths.append((self.time, *self.state()))
            fresh = self._receive(self.time)
            if fresh is not None:
                self.estimate = fresh
                for when, q, v in reversed(self._truths):
                    if abs(when - fresh.time) < 1e-9:
                        self.errors.add(fresh, q, v)
                        break
            self._is_read = True
        estimate = self.estimate
        age = self.time - estimate.time
        q = self.robot.integrate(estimate.q, estimate.v, age) if age > 0.0 else estimate.q.copy()
        return q, estimate.v.copy()

    def step(self, torque: ArrayLike, dt: float | None = None) -> None:
        """Hold joint torques (nv-6,) as :meth:`wbc.simulation.Plant.step` does."""
        if not self._is_read:
            self.measure()
        super().step(torque, dt)
        self._is_read = False

    @property
    def felt_forces(self) -> dict[str, Array]:
        """Wrench (6,) on each sole by its frame, as estimated from torques; else empty."""
        forces = self.estimate.forces.items()
        return {self.robot.feet[name].frame: force for name, force in forces}

    @property
    def felt_loads(self) -> dict[str, float]:
        """Estimated vertical force by foot [N]; the weight for a contact without an estimate."""
        forces, held = self.estimate.forces, self.estimate.contacts
        return {
            name: float(forces[name][2]) if name in forces else self.robot.weight * (name in held)
            for name in self.robot.feet
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """What the physics omits, errors of the estimates, and their most frequent notes."""
        if not self.errors.count:
            return super().notes
        lost = (f"bus: {self.sensing.lost} messages lost",) if self.sensing.lost else ()
        return (*super().notes, str(self.errors), *lost, *frequent_notes(self.told))

    def _receive(self, time: float) -> Estimate | None:
        """Return the last estimate by the messages that arrived until ``time`` [s], if any."""
        last = None
        for message in self.sensing.received(time):
            estimate = self.estimator.update(message)
            if estimate is not None:
                count_notes(self.told, estimate.notes)
                last = estimate
        return last
