"""IMUs and soles of a robot as its joints place them: what an IMU sees of feet and base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.estimation.contact_filter import ContactFilter
from wbc.estimation.imus import ImuMount
from wbc.estimation.settings import EstimatorSettings
from wbc.native import doubles, lib
from wbc.robot import Robot
from wbc.robot.mounted import Mount, MountedFrames
from wbc.validate import Array


class Sight:
    """The robot's kinematics between IMUs and soles, at the joint positions of :meth:`look`.

    Attributes
    ----------
    feet:
        Names.
    flat:
        Which have soles, whose rotation says something; points' does not.
    places:
        (feet, 15) as :meth:`place` left them.
    """

    def __init__(self, robot: Robot, imus: Sequence[ImuMount], settings: EstimatorSettings) -> None:
        self.feet = tuple(robot.feet)
        self.flat = tuple(len(foot.polygon) > 2 for foot in robot.feet.values())
        soles = [Mount(foot.frame, np.zeros(3), np.eye(3)) for foot in robot.feet.values()]
        self._robot, self._first = robot, len(imus)
        self._mounted = MountedFrames(robot, [*(one.mount for one in imus), *soles])
        self._rows = [doubles(row) for row in self._mounted.frames]
        self._variance = settings.encoder_deviation**2
        self._floor = np.array((settings.place_floor, settings.turn_floor)) ** 2
        self.places = np.zeros((len(soles), int(lib.PLACE_SIZE)))
        self._noises = np.zeros((len(soles), 6, 6))

    def look(self, positions: Array) -> None:
        """Go to joint positions (nv-6,) [rad or m]."""
        self._mounted.at(positions)

    def imu_rotation(self, k: int) -> Array:
        """Return the rotation (3, 3) from an IMU's axes to the base's."""
        return self._mounted.rotation(k)

    def imu_origin(self, k: int) -> Array:
        """Return where an IMU is from the base (3,) [m], in its axes."""
        return self._mounted.origin(k)

    def soles_middle(self) -> Array:
        """Return the mean of the soles' places from the base (3,) [m], in its axes."""
        return self._mounted.frames[self._first :, :3].mean(axis=0)

    def place(self, foot: int, imu: int, rates: Array) -> tuple[Array, Array]:
        """Return where an IMU sees a foot, and how surely; see ``ContactFilter.correct``.

        Behind position and rotation stands its velocity (3,) in the IMU's axes by joints that move
        at ``rates`` (nv-6,). All is overwritten by the next call.
        """
        place, noise = self.places[foot], self._noises[foot]
        lib.wbc_foot_place(
            self._robot.nv,
            *(self._rows[imu], self._rows[self._first + foot], doubles(rates), self._variance),
            *(doubles(self._floor), doubles(place), doubles(noise)),
        )
        return place, noise

    def state(
        self, filter_: ContactFilter, imu: int, rate: Array, positions: Array, rates: Array
    ) -> tuple[Array, Array]:
        """Return configuration (nq,) and velocity (nv,) of the robot that carries the IMU."""
        robot = self._robot
        q, v = np.empty(robot.nq), np.empty(robot.nv)
        filter_.base(robot.nv, self._rows[imu], rate, rates, q, v)
        robot.limits.write_positions(q, positions)
        return q, v
