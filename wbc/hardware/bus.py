"""The messages between controller and robot: readings one way, commands the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from time import monotonic
from typing import Protocol, TypeVar

import numpy as np

from wbc.errors import WbcError
from wbc.validate import Array

RESTART_GAP = 1000  # a sequence number that is lower by more is of a restarted sender
RESTART_TIME = 1.0  # s after the last message, from which on any number is


class BusError(WbcError):
    """A bus cannot be opened, or the system refuses to send; the message says what to do."""


@dataclass(frozen=True, eq=False)
class BaseTruth:
    """The base's true state, from a simulated robot only.

    Attributes
    ----------
    pose:
        Position [m] and quaternion x y z w (7,), as q[:7].
    velocity:
        Linear [m/s] and angular [rad/s] in the base's axes (6,), as v[:6].
    """

    pose: Array
    velocity: Array


# What is measured of joints and by the IMU, by names in a reading.
JOINT_ROWS = ("position", "velocity", "torque", "temperature")
IMU_ROWS = ("quaternion", "angular_velocity", "specific_force")
ROWS = (*JOINT_ROWS, *IMU_ROWS)


@dataclass(frozen=True, eq=False)
class Reading:
    """One message of a robot, as it came, not checked yet.

    Joints are in the order of the robot's model, v[6:], whatever the order on the bus.

    Attributes
    ----------
    sequence:
        Number of the message, to detect repeated and late ones.
    time:
        Of the measurement by the robot's clock [s].
    position, velocity, torque:
        Of the joints (n,) [rad or m, and per second], [N m or N].
    temperature:
        Of the motors (n,) [degrees C].
    quaternion:
        Rotation x y z w of the IMU to the world (4,), by the IMU's own filter; its heading drifts.
    angular_velocity, specific_force:
        Of the IMU (3,), in its axes [rad/s], [m/s^2]; at rest the force is +9.81 upwards.
    stop:
        Whether the stop button of the robot's remote control is pressed.
    base_truth:
        The base's true state, from a simulated robot that sends it; else None.
    """

    sequence: int
    time: float
    position: Array
    velocity: Array
    torque: Array
    temperature: Array
    quaternion: Array
    angular_velocity: Array
    specific_force: Array
    stop: bool = False
    base_truth: BaseTruth | None = None

    def __post_init__(self) -> None:
        for name in ROWS:
            given = getattr(self, name)
            if not isinstance(given, np.ndarray):  # lists, as drivers make them
                with suppress(TypeError, ValueError):  # what is no row of numbers is found later
                    object.__setattr__(self, name, np.asarray(given, dtype=float))
        if isinstance(self.sequence, np.integer):  # whose differences wrap around
            object.__setattr__(self, "sequence", int(self.sequence))
        for name in ("sequence", "time"):
            if not isinstance(getattr(self, name), int | float | np.number):
                object.__setattr__(self, name, np.nan)  # no number, as checks find


@dataclass(frozen=True, eq=False)
class Command:
    """A motor command: tau = torque + kp (position - q) + kd (velocity - q'), at the motors' rate.

    Joints are in the order of the robot's model, v[6:].

    Attributes
    ----------
    sequence:
        Number of the message, to detect repeated and late ones.
    position, velocity, torque:
        (n,) [rad or m, and per second], [N m or N].
    kp, kd:
        Gains (n,) [N m/rad], [N m s/rad].
    enabled:
        Whether motors are powered at all.
    """

    sequence: int
    position: Array
    velocity: Array
    torque: Array
    kp: Array
    kd: Array
    enabled: bool = True

    @classmethod
    def damping(cls, kd: Array, *, enabled: bool = True) -> Command:
        """Return a pure damping command: zero torque, no stiffness, gains ``kd`` (n,)."""
        zero = np.zeros(len(kd))
        return cls(0, zero, zero, zero, zero, kd if enabled else zero, enabled)

    @property
    def is_passive(self) -> bool:
        """Whether it can only dissipate energy."""
        still = not (self.kp.any() or self.torque.any())
        return not self.enabled or (still and not (self.kd * self.velocity).any())

    def numbered(self, sequence: int) -> Command:
        """Return the same with another number."""
        return replace(self, sequence=sequence)

    def motor_torque(self, position: Array, velocity: Array) -> Array:
        """Return the motors' torques (n,) at a state, before their limits [N m or N]."""
        if not self.enabled:
            return np.zeros(len(self.torque))
        feedback = self.kp * (self.position - position) + self.kd * (self.velocity - velocity)
        return self.torque + feedback


Message = TypeVar("Message", Reading, Command)


def rows_of(size: int, *values: object) -> Array | None:
    """Return values of joints as rows (k, size); None for other sizes, or not real numbers."""
    try:
        rows = np.array(values)
    except ValueError:  # of different sizes
        return None
    fits = rows.shape == (len(values), size) and rows.dtype.kind in "fiu"
    return rows.astype(float, copy=False) if fits else None


class MessageOrder:
    """Detects repeated and late messages; a restarted sender may count from 0."""

    def __init__(self) -> None:
        self._last, self._last_time = -1, 0.0

    def is_new(self, sequence: int) -> bool:
        """Return whether a message is new, which makes it the last one."""
        now = monotonic()
        is_old = self._last - RESTART_GAP <= sequence <= self._last
        is_late = is_old and now - self._last_time < RESTART_TIME
        if not is_late:
            self._last, self._last_time = sequence, now
        return not is_late


def newest(
    messages: Iterable[Message | None], is_new: Callable[[int], bool], dropped: Counter[str]
) -> Message | None:
    """Return the newest of messages, None being damaged ones; count the dropped."""
    last: Message | None = None
    for message in messages:
        if message is None:
            dropped["damaged"] += 1
        elif not is_new(message.sequence):
            dropped["repeated or out of order"] += 1
        else:
            last = message
    return last


def thrown_away(dropped: Counter[str]) -> str:
    """Return how many messages were dropped, and why, to end a sentence."""
    counts = ", ".join(f"{count} {reason}" for reason, count in dropped.items() if count)
    return f"; thrown away: {counts}" if counts else ""


class Bus(Protocol):
    """The controller's end of a robot's bus."""

    dropped: Counter[str]
    """Number of dropped messages, by reason."""

    def read(self) -> Reading | None:
        """Return the newest reading since the last call; None without any. It never blocks.

        Raises
        ------
        BusError, OSError
            The system refuses: the loop takes that as no reading.
        """

    def write(self, command: Command) -> None:
        """Send a command; it never blocks.

        Raises
        ------
        BusError, OSError
            The system refuses.
        """

    def close(self) -> None:
        """Close the bus."""


class RobotBus(Protocol):
    """The robot's end of a bus: what ``wbc hardware sim`` serves."""

    dropped: Counter[str]
    """Number of dropped messages, by reason."""

    def receive(self) -> Command | None:
        """Return the newest command since the last call; None without any.

        Repeated and late ones are dropped. It never blocks.
        """

    def send(self, reading: Reading) -> None:
        """Send a reading; it never blocks."""

    def close(self) -> None:
        """Close the bus."""
