"""How an estimate begins: a robot that stands still for a moment."""

from __future__ import annotations

import math

import numpy as np

from wbc.errors import InvalidInputError
from wbc.estimation.contact_filter import SHOWN, ContactFilter
from wbc.estimation.measurement import ImuReading, Measurement
from wbc.estimation.settings import EstimatorSettings
from wbc.estimation.sight import Sight
from wbc.robot.limits import BASE_NQ
from wbc.rotations import exp_rotation, rotation_from
from wbc.validate import Array

TILT = 0.05  # rad: standard deviation of the tilt by the mean specific force of a robot at rest
SWAYED = 0.1  # rad/s: beyond it a mean rate, or that of a joint, is not one of standing still


class Beginning:
    """Collects messages until the robot stood still long enough.

    Parameters
    ----------
    leader:
        Name of the IMU that counts.
    duration:
        How long [s].
    """

    def __init__(self, leader: str, duration: float) -> None:
        self._leader, self._duration = leader, duration
        self._waiting: list[Measurement] = []

    def collect(self, m: Measurement) -> list[Measurement] | None:
        """Take in a message; return all of them when it stood long enough.

        Whenever it moves, waiting begins anew. Messages that come late or twice are left out:
        standing, nothing is lost with them.
        """
        waiting = self._waiting
        heard = any(one.name == self._leader for one in m.imus)
        if (waiting and m.time <= waiting[-1].time) or (not waiting and not heard):
            return None
        waiting.append(m)
        if m.time - waiting[0].time < self._duration - 1e-9:
            return None
        rate = self.mean.angular_velocity
        way = float(np.abs(m.positions - waiting[0].positions).max(initial=0.0))
        if np.linalg.norm(rate) > SWAYED or way > SWAYED * self._duration:
            self._waiting = [m] if heard else []
            return None
        return waiting

    @property
    def mean(self) -> ImuReading:
        """What the leading IMU said, on the mean."""
        rate = np.mean([one.angular_velocity for one in self._readings()], axis=0)
        force = np.mean([one.specific_force for one in self._readings()], axis=0)
        return ImuReading(self._leader, rate, force)

    def _readings(self) -> list[ImuReading]:
        return [one for m in self._waiting for one in m.imus if one.name == self._leader]


def level(
    filter_: ContactFilter,
    sight: Sight,
    mean: ImuReading,
    gravity: Array,
    q: Array | None,
    settings: EstimatorSettings,
) -> None:
    """Begin a filter with the tilt that an IMU at rest has on the mean, and nothing moving.

    Tilt and the gyroscope's bias by the mean are where the filter begins; what it knows of them it
    learns from the readings, one by one.

    Parameters
    ----------
    sight:
        At the joints' positions now.
    q:
        (nq,) whose base position and heading it is; None: heading 0, and the soles' middle at the
        world's origin.
    """
    force = mean.specific_force
    if np.linalg.norm(force) < 0.5 * np.linalg.norm(gravity):
        raise InvalidInputError(
            f"estimator: a robot at rest feels {np.linalg.norm(gravity):.2f} m/s^2, the IMU says"
            f" {np.linalg.norm(force):.2f}: are its units g, or is it falling?"
        )
    up = -gravity / np.linalg.norm(gravity)
    own = sight.imu_rotation(0)
    R_imu = _shortest(force / np.linalg.norm(force), up)  # with some heading
    forwards = (R_imu @ own.T)[:, 0]
    wanted = np.eye(3)[0] if q is None else rotation_from(q[3:BASE_NQ])[:, 0]
    turn = math.atan2(wanted[1], wanted[0]) - math.atan2(forwards[1], forwards[0])
    R_imu = exp_rotation(np.array((0.0, 0.0, turn))) @ R_imu
    R = R_imu @ own.T
    base = -R @ sight.soles_middle() if q is None else q[:3]
    P = np.zeros((SHOWN, SHOWN))
    P[:3, :3] = TILT**2 * (np.eye(3) - np.outer(up, up))
    P[9:, 9:] = bias_covariance(settings)
    place, bias = base + R @ sight.imu_origin(0), mean.angular_velocity
    filter_.reset(R_imu, place, gyroscope_bias=bias, covariance=P)


def bias_covariance(settings: EstimatorSettings) -> Array:
    """Return that of an IMU's biases (6, 6) before anything is known of them."""
    return np.diag(np.repeat((settings.gyroscope_bias, settings.accelerometer_bias), 3) ** 2)


def _shortest(a: Array, b: Array) -> Array:
    """Return the shortest rotation (3, 3) from one unit vector to another."""
    axis = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine < 1e-12:
        across = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        return np.eye(3) if cosine > 0.0 else exp_rotation(np.pi * across / np.linalg.norm(across))
    return exp_rotation(math.atan2(sine, cosine) / sine * axis)
