"""Imperfect measurement of the state: noise, bias, delay, lost frames; and late commands."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.notes import doubt_delay
from wbc.simulation.mismatch import seed_number
from wbc.validate import Array, check_fields, set_fields


@dataclass(frozen=True)
class Sensors:
    """Imperfections of measurement and command, off by default.

    Noise is white and normal, with these standard deviations, drawn in each control period.

    Attributes
    ----------
    position_noise, velocity_noise:
        Of the joints [rad or m], [rad/s or m/s].
    position_bias:
        Of a constant offset of each joint [rad or m], drawn at the reset.
    base_position_noise, base_rotation_noise:
        Of the base's position along each axis [m], and rotation about each [rad].
    base_velocity_noise, base_rate_noise:
        Of its linear [m/s] and angular velocity [rad/s] along each axis.
    delay:
        Age of the measurement [s]; at first the state at the reset is measured.
    latency:
        Delay of a torque [s]; the first one counts as given before the reset.
    dropout:
        Probability that the frame of a control period is lost.
    seed:
        Of the random numbers, restarted at each reset.
    """

    position_noise: float = 0.0
    velocity_noise: float = 0.0
    position_bias: float = 0.0
    base_position_noise: float = 0.0
    base_rotation_noise: float = 0.0
    base_velocity_noise: float = 0.0
    base_rate_noise: float = 0.0
    delay: float = 0.0
    latency: float = 0.0
    dropout: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_fields(self, "sensors, ", *_noises(), "delay", "latency", "dropout", least=0.0)
        if self.dropout >= 1.0:
            raise InvalidInputError(
                f"sensors, dropout: a probability below 1, or no frame comes; got {self.dropout:g}"
            )
        set_fields(self, seed=seed_number("sensors, seed", self.seed))


def _noises() -> list[str]:
    return [one.name for one in fields(Sensors) if one.name.endswith(("_noise", "_bias"))]


def doubt_delays(sensors: Sensors) -> None:
    """Warn of delays that no robot stands with."""
    doubt_delay(f"sensors: a delay of {sensors.delay:g} s", sensors.delay)
    doubt_delay(f"sensors: a latency of {sensors.latency:g} s", sensors.latency)


class Measurements:
    """Measures states with the imperfections of sensors, from one reset to the next."""

    def __init__(self, robot: Robot, sensors: Sensors) -> None:
        self._robot, self._sensors = robot, sensors
        self._random = np.random.default_rng(sensors.seed)
        joints = robot.nv - BASE_NV
        s = sensors
        place = [s.base_position_noise, s.base_rotation_noise]
        rates = [s.base_velocity_noise, s.base_rate_noise]
        if robot.fixed_base:
            place = rates = [0.0, 0.0]
        self._position = np.concatenate((np.repeat(place, 3), np.full(joints, s.position_noise)))
        self._velocity = np.concatenate((np.repeat(rates, 3), np.full(joints, s.velocity_noise)))
        self._bias = np.zeros(robot.nv)
        self._bias[BASE_NV:] = s.position_bias * self._random.normal(size=joints)
        self._noisy = bool(any(getattr(s, name) for name in _noises()))

    def measure(self, q: Array, v: Array) -> tuple[Array, Array] | None:
        """Return the measurement of a state, or None for a lost frame.

        Every call draws the same number of random numbers.
        """
        lost = bool(self._random.uniform() < self._sensors.dropout)
        noise = self._random.normal(size=(2, self._robot.nv))
        if lost:
            return None
        if not self._noisy:
            return q, v
        error = self._position * noise[0] + self._bias
        return self._robot.integrate(q, error, 1.0), v + self._velocity * noise[1]
