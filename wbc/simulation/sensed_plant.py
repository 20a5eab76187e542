"""A plant whose state is not told: it is estimated from the devices of the robot."""

from __future__ import annotations

import re
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.estimation import Estimate, EstimatorSettings, StateEstimator
from wbc.kinds import check_kind
from wbc.robot import Robot
from wbc.simulation.estimate_errors import EstimateErrors
from wbc.simulation.plant import PERFECT, Plant
from wbc.simulation.sensors import Sensors
from wbc.simulation.sensors_devices import Devices
from wbc.simulation.sensors_reading import Sensing
from wbc.validate import Array

TRUTHS = 64  # control periods for which a message may be under way and still be compared
MOST_NOTES = 5
MORE = 50  # control periods to stand, since messages may be lost and IMUs slow
NUMBER = re.compile(r"\d+(\.\d+)?")


class SensedPlant(Plant):
    """A :class:`~wbc.simulation.Plant` that tells what an estimator makes of its devices.

    :meth:`measure` gives the estimate, predicted over the age of the last message by its own
    velocities, and :attr:`felt_forces` the estimated forces on the soles; :meth:`state` and
    :attr:`contact_forces` are still the truth, for verdicts and comparisons. At the reset it is
    held where it stands for as long as the estimator stands to begin; devices run before time 0.

    Parameters
    ----------
    devices:
        The robot's sensors; by default a common humanoid's.
    settings:
        Of the estimator; the encoders' delay is known to it unless they say otherwise.
    others:
        As of :class:`~wbc.simulation.Plant`; of ``sensors`` only the latency of torques.

    Attributes
    ----------
    devices, estimator:
        As given, and made of it.
    sensing:
        Reads the devices.
    estimate:
        The last one.
    errors:
        Of the estimates so far, by the truth.
    told:
        What estimates noted, numbers left out, with how often.
    """

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
                "plant, sensors: noise on the true state, which is not told here; of these give"
                " latency only, and devices"
            )
        check_kind("plant, devices", devices, Devices, "Devices()", or_none=True)
        check_kind("plant, settings", settings, EstimatorSettings, or_none=True)
        self.devices = devices or Devices()
        known = settings or EstimatorSettings(encoder_delay=self.devices.encoders.delay)
        mounts = [one.mount for one in self.devices.imus]
        self.estimator = StateEstimator(robot, mounts, known, dt=dt)
        self.told: dict[str, int] = {}
        self._read = False
        self.errors = EstimateErrors()
        super().__init__(robot, dt=dt, **others)

    def reset(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Begin at rest at ``q`` (nq,), whose base position and heading the estimator is told.

        Raises
        ------
        InvalidInputError
            An unusable state, or one that moves: a robot stands while its estimator begins.
        """
        self._truths = deque[tuple[float, Array, Array]](maxlen=TRUTHS)
        super().reset(q, v)
        if v is not None and np.any(v):
            raise InvalidInputError(
                "plant, v: a robot whose state is estimated begins at rest; leave it out"
            )
        self.sensing, self.told, self.errors = Sensing(self, self.devices), {}, EstimateErrors()
        self.estimate: Estimate | None = None
        self.estimator.reset(q)
        bus = self.devices.bus
        before = self.estimator.settings.standing_time + bus.delay + bus.jitter
        for k in range(-int(np.ceil(before / self.dt)) - MORE, 0):
            self.sensing.read(self, k * self.dt)
            self._take(k * self.dt)
        if self.estimate is None:
            raise InvalidInputError(
                f"plant, devices: the estimator cannot begin: {self.estimator.kept_by}"
            )
        self._read = False

    def measure(self) -> tuple[Array, Array] | None:
        """Return configuration and velocity as estimated; None if no message came yet.

        However often it is asked within one control period, the answer is the same.
        """
        if not self._read:
            self.sensing.read(self)
            self._truths.append((self.time, *self.state()))
            self._take(self.time)
            self._read = True
        found = self.estimate
        if found is None:
            return None
        age = self.time - found.time
        q = self.robot.integrate(found.q, found.v, age) if age > 0.0 else found.q.copy()
        return q, found.v.copy()

    def step(self, torque: ArrayLike, dt: float | None = None) -> None:
        """Hold joint torques (nv-6,) as :meth:`wbc.simulation.Plant.step` does."""
        if not self._read:
            self.measure()
        super().step(torque, dt)
        self._read = False

    @property
    def felt_forces(self) -> dict[str, Array]:
        """Wrench (6,) on each sole by its frame, as estimated from torques; else empty."""
        forces = self.estimate.forces if self.estimate is not None else {}
        return {self.robot.feet[name].frame: force for name, force in forces.items()}

    @property
    def felt_loads(self) -> dict[str, float]:
        """Vertical force by foot [N] as estimated; a foot that is counted on bears by any means."""
        forces = self.estimate.forces if self.estimate is not None else {}
        held = self.estimate.contacts if self.estimate is not None else ()
        return {
            name: float(forces[name][2]) if name in forces else self.robot.weight * (name in held)
            for name in self.robot.feet
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """What the physics leaves out, how good the estimates were, and what they noted most."""
        if not self.errors.count:
            return super().notes
        most = sorted(self.told.items(), key=lambda one: -one[1])[:MOST_NOTES]
        told = (f"estimate, {count} times: {note}" for note, count in most)
        lost = (f"bus: {self.sensing.lost} messages lost",) if self.sensing.lost else ()
        return (*super().notes, str(self.errors), *lost, *told)

    def _take(self, time: float) -> None:
        fresh = False
        for message in self.sensing.received(time):
            estimate = self.estimator.update(message)
            if estimate is None:
                continue
            self.estimate, fresh = estimate, True
            for note in estimate.notes:
                kind = NUMBER.sub("#", note)
                self.told[kind] = self.told.get(kind, 0) + 1
        if self.estimate is None or not fresh:
            return
        for when, q, v in reversed(self._truths):
            if abs(when - self.estimate.time) < 1e-9:
                self.errors.add(self.estimate, q, v)
                break
