"""A humanoid's devices: IMUs, encoders, motor currents, foot switches, and their bus.

Defaults are those of common devices, from public data sheets. IMU: Xsens
MTi-1 series, noise densities 0.007 degrees/s/Hz^(1/2) and 120 ug/Hz^(1/2), in-run bias
instabilities 10 degrees/h and 30 ug. Encoders: 14 bits a turn at the joint (ams AS5047P and
others). A data sheet's in-run instability is not a random walk: the walks here pass it in a minute.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.estimation.measurement import ImuMount
from wbc.kinds import check_kind, check_switches
from wbc.simulation.mismatch import seed_number
from wbc.validate import check_fields, list_of, set_fields

_G = 9.80665


@dataclass(frozen=True, eq=False)
class Imu:
    """An IMU; a reading is the mean over its period, as of real devices.

    Attributes
    ----------
    name, frame, position, rotation:
        As in :class:`~wbc.estimation.ImuMount`.
    rate:
        Readings a second [1/s]; None: one in each control period.
    gyroscope_noise, accelerometer_noise:
        Densities of white noise [rad/s/Hz^(1/2)], [m/s^2/Hz^(1/2)].
    gyroscope_bias, accelerometer_bias:
        Standard deviations of the biases [rad/s], [m/s^2], drawn at the reset.
    gyroscope_walk, accelerometer_walk:
        Densities of the white noise that the biases integrate [rad/s^2/Hz^(1/2)],
        [m/s^3/Hz^(1/2)].
    most_rate, most_force:
        Measurement ranges [rad/s], [m/s^2], at which readings are clipped.
    """

    name: str = "imu"
    frame: str = "base"
    position: ArrayLike = (0.0, 0.0, 0.0)
    rotation: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    rate: float | None = None
    gyroscope_noise: float = math.radians(0.007)
    accelerometer_noise: float = 120e-6 * _G
    gyroscope_bias: float = math.radians(0.5)
    accelerometer_bias: float = 0.02
    gyroscope_walk: float = math.radians(10.0) / 3600.0 / 60.0**0.5
    accelerometer_walk: float = 30e-6 * _G / 60.0**0.5
    most_rate: float = math.radians(2000.0)
    most_force: float = 16.0 * _G

    def __post_init__(self) -> None:
        what = f"IMU {self.name!r}, "
        devices, kinds = ("gyroscope", "accelerometer"), ("noise", "bias", "walk")
        noises = [f"{device}_{kind}" for device in devices for kind in kinds]
        check_fields(self, what, *noises, least=0.0)
        check_fields(self, what, "most_rate", "most_force", above=0.0)
        if self.rate is not None:
            check_fields(self, what, "rate", above=0.0)
        _ = self.mount

    @property
    def mount(self) -> ImuMount:
        """Its mount, as the estimator knows it."""
        place = self.name, self.frame, self.position, self.rotation
        return ImuMount(*place, 0.999 * self.most_rate, 0.999 * self.most_force)

    def period(self, dt: float) -> float:
        """Return the time between readings [s], a multiple of the control period ``dt``.

        Raises
        ------
        InvalidInputError
            It is not.
        """
        periods = 1.0 if self.rate is None else 1.0 / (self.rate * dt)
        if abs(periods - round(periods)) > 1e-6 or round(periods) < 1:
            raise InvalidInputError(
                f"IMU {self.name!r}, rate: {self.rate:g} readings a second are not one in a whole"
                f" number of control periods of {dt:g} s"
            )
        return round(periods) * dt


@dataclass(frozen=True)
class Encoders:
    """Encoders of all joints.

    Attributes
    ----------
    resolution:
        Step of a reading [rad or m].
    noise:
        White noise, before rounding [rad or m].
    delay:
        Age of a reading at the message's time [s].
    rates:
        Whether the drives send velocities, too.
    rate_noise:
        White noise of these [rad/s or m/s].
    """

    resolution: float = 2.0 * math.pi / 2**14
    noise: float = 0.0
    delay: float = 0.0
    rates: bool = False
    rate_noise: float = 0.02

    def __post_init__(self) -> None:
        check_fields(self, "encoders, ", "resolution", "noise", "delay", "rate_noise", least=0.0)
        check_switches(self, "encoders, ", "rates")


@dataclass(frozen=True)
class MotorTorques:
    """Joint torques from motor currents.

    Attributes
    ----------
    noise:
        White noise [N m or N].
    friction:
        Unmodelled friction of gears, against their motion, as a ratio of the joint's effort limit:
        in readings, not in the physics.
    gain:
        Standard deviation of the gain errors of the readings, by joint, drawn at the reset.
    """

    noise: float = 0.1
    friction: float = 0.01
    gain: float = 0.02

    def __post_init__(self) -> None:
        check_fields(self, "motor torques, ", "noise", "friction", "gain", least=0.0)


@dataclass(frozen=True)
class FootSwitches:
    """Switches under the soles.

    Attributes
    ----------
    force:
        Normal force at which one closes [N].
    """

    force: float = 20.0

    def __post_init__(self) -> None:
        check_fields(self, "foot switches, ", "force", above=0.0)


@dataclass(frozen=True)
class MessageBus:
    """The transport of messages, which are stamped at measurement.

    Attributes
    ----------
    delay:
        Shortest transport time [s].
    jitter:
        Additional time, uniformly distributed [s]; messages may overtake each other.
    loss:
        Probability that a message is lost.
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self, "bus, ", "delay", "jitter", "loss", least=0.0)
        if self.loss >= 1.0:
            raise InvalidInputError(f"bus, loss: a probability below 1, got {self.loss:g}")


@dataclass(frozen=True, eq=False)
class Devices:
    """All sensors of a robot, and their bus.

    Attributes
    ----------
    imus:
        At least one.
    torques, feet:
        None: there are none.
    seed:
        Of the random numbers, restarted at each reset.
    """

    imus: Sequence[Imu] = field(default_factory=lambda: (Imu(),))
    encoders: Encoders = field(default_factory=Encoders)
    torques: MotorTorques | None = field(default_factory=MotorTorques)
    feet: FootSwitches | None = None
    bus: MessageBus = field(default_factory=MessageBus)
    seed: int = 0

    def __post_init__(self) -> None:
        given = (self.imus,) if isinstance(self.imus, Imu) else self.imus
        imus = list_of("devices, imus", given, Imu, "Imu()")
        if not imus:
            raise InvalidInputError("devices, imus: there are none; give one, such as Imu()")
        for name, kind, optional in (
            ("encoders", Encoders, False),
            ("torques", MotorTorques, True),
            ("feet", FootSwitches, True),
            ("bus", MessageBus, False),
        ):
            what, example = f"devices, {name}", f"{kind.__name__}()"
            check_kind(what, getattr(self, name), kind, example, or_none=optional)
        names = [one.name for one in imus]
        if len(set(names)) < len(names):
            raise InvalidInputError(f"devices, imus: names must differ, got {names}")
        set_fields(self, imus=imus, seed=seed_number("devices, seed", self.seed))
