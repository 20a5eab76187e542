"""A plant whose state is not told: it is estimated from the devices of the robot."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.estimation import Estimate, EstimatorSettings, StateEstimator
from wbc.robot import Robot
from wbc.simulation.plant import Plant
from wbc.simulation.sensors_devices import Devices
from wbc.simulation.sensors_reading import Sensing
from wbc.validate import Array


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
        As of :class:`~wbc.simulation.Plant`, but ``sensors``, which this one has none of.

    Attributes
    ----------
    devices, estimator:
        As given, and made of it.
    sensing:
        Reads the devices.
    estimate:
        The last one.
    told:
        What estimates noted, each note once, with how often.
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
        if "sensors" in others:
            raise InvalidInputError(
                "plant: sensors add noise to the true state, which is not told here; give devices"
            )
        self.devices = devices or Devices()
        known = settings or EstimatorSettings(encoder_delay=self.devices.encoders.delay)
        mounts = [one.mount for one in self.devices.imus]
        self.estimator = StateEstimator(robot, mounts, known, dt=dt)
        self.told: dict[str, int] = {}
        super().__init__(robot, dt=dt, **others)

    def reset(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Begin at rest at ``q`` (nq,), whose base position and heading the estimator is told.

        Raises
        ------
        InvalidInputError
            An unusable state, or one that moves: a robot stands while its estimator begins.
        """
        super().reset(q, v)
        if v is not None and np.any(v):
            raise InvalidInputError(
                "plant, v: a robot whose state is estimated begins at rest; leave it out"
            )
        self.sensing, self.told = Sensing(self, self.devices), {}
        self.estimate: Estimate | None = None
        self.estimator.reset(q)
        count = int(np.ceil(self.estimator.settings.standing_time / self.dt))
        for k in range(-count - 1, 0):
            self.sensing.read(self, k * self.dt)
            self._take(k * self.dt)
        self._read = False

    def measure(self) -> tuple[Array, Array] | None:
        """Return configuration and velocity as estimated; None if no message came yet.

        However often it is asked within one control period, the answer is the same.
        """
        if not self._read:
            self.sensing.read(self)
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
        """Wrench (6,) on each sole by its frame, as estimated from torques; without any: empty."""
        forces = self.estimate.forces if self.estimate is not None else {}
        return {self.robot.feet[name].frame: force for name, force in forces.items()}

    def _take(self, time: float) -> None:
        for message in self.sensing.received(time):
            estimate = self.estimator.update(message)
            self.estimate = estimate or self.estimate
            for note in estimate.notes if estimate is not None else ():
                self.told[note] = self.told.get(note, 0) + 1
