"""A robot's sensor readings at one instant, one message of its bus; and the mounts of its IMUs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.kinds import check_word, switch
from wbc.robot.mounted_frames import Mount, mount
from wbc.validate import (
    Array,
    by_name,
    check_fields,
    finite_array,
    finite_number,
    list_of,
    read_only,
    real_array,
    set_fields,
)


@dataclass(frozen=True, eq=False)
class ImuReading:
    """Reading of an IMU, in its own axes; means since its last reading, as devices integrate.

    Attributes
    ----------
    name:
        Of the IMU in the estimator.
    angular_velocity:
        (3,) [rad/s].
    specific_force:
        Acceleration minus gravity (3,) [m/s^2]: of a device at rest +9.81 upwards.

    Raises
    ------
    InvalidInputError
        Other shapes, or NaN.
    """

    name: str
    angular_velocity: Array
    specific_force: Array

    if TYPE_CHECKING:  # array-likes are given, arrays are read

        def __init__(
            self, name: str, angular_velocity: ArrayLike, specific_force: ArrayLike
        ) -> None: ...

    def __post_init__(self) -> None:
        check_word("IMU reading, name", self.name)
        for key in ("angular_velocity", "specific_force"):
            value = finite_array(f"IMU {self.name!r}, {key}", getattr(self, key), (3,))
            object.__setattr__(self, key, read_only(value))


@dataclass(frozen=True, eq=False)
class Measurement:
    """Sensor readings, with the time of measurement; joints as in v[6:].

    Attributes
    ----------
    time:
        Of the measurement by the robot's clock [s], not of the arrival.
    positions:
        Of the joints (nv-6,) [rad or m].
    velocities:
        Their rates (nv-6,) [rad/s or m/s]; None: no such sensor, see
        :class:`~wbc.estimation.joint_velocity.JointVelocityFilter`.
    torques:
        Of the motors (nv-6,) [N m or N]; None: unknown.
    imus:
        New readings of IMUs.
    contacts:
        Foot switches of all feet, whether each is pressed; None: there are none.
    forces:
        Normal forces of all feet [N]; None: no such sensor.

    Raises
    ------
    InvalidInputError
        Values that are no numbers or NaN, by name.
    """

    time: float
    positions: Array
    velocities: Array | None = None
    torques: Array | None = None
    imus: tuple[ImuReading, ...] = ()
    contacts: Mapping[str, bool] | None = None
    forces: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        positions = real_array("measurement, positions", self.positions).shape
        if len(positions) != 1:
            raise InvalidInputError(
                f"measurement, positions: expected one number per joint, got shape {positions}"
            )
        checked: dict[str, object] = {"time": finite_number("measurement, time", self.time)}
        for key in ("positions", "velocities", "torques"):
            value: ArrayLike | None = getattr(self, key)
            if value is not None:
                checked[key] = read_only(finite_array(f"measurement, {key}", value, positions))
        example = "ImuReading(name, angular_velocity, specific_force)"
        checked["imus"] = given = list_of("measurement, imus", self.imus, ImuReading, example)
        if len({one.name for one in given}) < len(given):
            names = ", ".join(one.name for one in given)
            raise InvalidInputError(
                f"measurement, imus: two readings of one IMU ({names}); give their mean"
            )
        if self.contacts is not None:
            pressed = by_name("measurement, contacts", self.contacts)
            checked["contacts"] = {
                name: switch(f"measurement, contacts, {name}", one) for name, one in pressed.items()
            }
        if self.forces is not None:
            felt = by_name("measurement, forces", self.forces)
            checked["forces"] = {
                name: finite_number(f"measurement, forces, {name}", one)
                for name, one in felt.items()
            }
        set_fields(self, **checked)


@dataclass(frozen=True, eq=False)
class ImuMount:
    """The mount of an IMU on the robot, and its ranges.

    Attributes
    ----------
    name:
        Of its readings.
    frame:
        A link or frame that carries it.
    position:
        (3,) [m], in the frame's axes.
    rotation:
        (3, 3) taking the IMU's axes to the frame's.
    most_rate, most_force:
        Measurement ranges [rad/s], [m/s^2]; readings beyond are not used. The defaults are
        2000 degrees/s and 16 g.
    """

    name: str = "imu"
    frame: str = "base"
    position: ArrayLike = (0.0, 0.0, 0.0)
    rotation: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    most_rate: float = 34.9
    most_force: float = 157.0

    def __post_init__(self) -> None:
        check_word("IMU, name", self.name)
        check_fields(self, f"IMU {self.name!r}, ", "most_rate", "most_force", above=0.0)
        _ = self.mount

    @property
    def mount(self) -> Mount:
        """Its frame, position and rotation, checked."""
        return mount(f"IMU {self.name!r}", self.frame, self.position, self.rotation)
