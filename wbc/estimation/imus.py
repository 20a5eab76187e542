"""IMUs of a robot: which one leads, and what it says when it says nothing usable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.estimation.measurement import ImuReading
from wbc.robot.mounted import Mount, mount
from wbc.validate import Array, check_fields

# A reading that comes as often as this with the same bits is one of a device that hangs.
FROZEN = 25
QUIET = 0.01  # s: an IMU may be slower than messages are
GUESSED = 100.0  # times the variance of a reading that was held


@dataclass(frozen=True, eq=False)
class ImuMount:
    """Where an IMU is on the robot, and what it can measure.

    Attributes
    ----------
    name:
        As its readings have it.
    frame:
        A link or frame that carries it.
    position:
        (3,) [m], in the frame's axes.
    rotation:
        (3, 3) taking the IMU's axes to the frame's.
    most_rate, most_force:
        Ends of its ranges [rad/s], [m/s^2]; a reading beyond is not believed. The defaults are
        2000 degrees/s and 16 g.
    """

    name: str = "imu"
    frame: str = "base"
    position: ArrayLike = (0.0, 0.0, 0.0)
    rotation: ArrayLike = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    most_rate: float = 34.9
    most_force: float = 157.0

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise InvalidInputError("IMU, name: expected a name")
        check_fields(self, f"IMU {self.name!r}, ", "most_rate", "most_force", above=0.0)
        _ = self.mount

    @property
    def mount(self) -> Mount:
        """Its frame, position and rotation, checked."""
        return mount(f"IMU {self.name!r}", self.frame, self.position, self.rotation)

    def doubt(self, reading: ImuReading) -> str | None:
        """Return why a reading is not believed, or None."""
        for value, most, what in (
            (reading.angular_velocity, self.most_rate, "angular velocity"),
            (reading.specific_force, self.most_force, "specific force"),
        ):
            x, y, z = value.tolist()  # a fifth of the time that NumPy takes for three numbers
            if not (-most <= x <= most and -most <= y <= most and -most <= z <= most):
                return f"IMU {self.name!r}: {what} beyond its range of {most:g}; not used"
        return None


class Inertial(NamedTuple):
    """What moves the filter over one period.

    Attributes
    ----------
    rate, force:
        (3,) angular velocity [rad/s] and specific force [m/s^2].
    scale:
        Of their variance: above 1 where they were guessed.
    leader:
        Number of the IMU that they are of.
    notes:
        What was not believed, in words.
    """

    rate: Array
    force: Array
    scale: float
    leader: int
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ImuWatch:
    """What is remembered of the IMUs from message to message; not changed, replaced.

    Attributes
    ----------
    leader:
        Number of the IMU that is used.
    heard:
        When each was last believed [s].
    last:
        Its last believed reading; None: none yet.
    same:
        How often in a row each said the same.
    """

    mounts: tuple[ImuMount, ...]
    timeout: float
    leader: int
    heard: tuple[float, ...]
    last: tuple[ImuReading | None, ...]
    same: tuple[int, ...]

    @classmethod
    def of(cls, mounts: Sequence[ImuMount], timeout: float, time: float) -> ImuWatch:
        """Return one that has heard nothing; the first IMU leads."""
        n = len(mounts)
        return cls(tuple(mounts), timeout, 0, (time,) * n, (None,) * n, (0,) * n)

    def seen(self, time: float, readings: Mapping[str, ImuReading]) -> tuple[ImuWatch, Inertial]:
        """Return what is remembered after a message at ``time`` [s], and what to go by."""
        heard, last, same = list(self.heard), list(self.last), list(self.same)
        notes, fresh = list[str](), set[int]()
        for k, one in enumerate(self.mounts):
            reading, before = readings.get(one.name), last[k]
            if reading is None:
                continue
            hangs = before is not None and _same(before, reading)
            same[k] = same[k] + 1 if hangs else 0
            doubt = one.doubt(reading)
            if doubt is None and same[k] >= FROZEN:
                doubt = f"IMU {one.name!r}: {same[k]} readings in a row are the same; not used"
            if doubt is None:
                heard[k], last[k] = time, reading
                fresh.add(k)
            else:
                notes.append(doubt)
        leader = self.leader
        if time - heard[leader] > self.timeout and fresh:
            leader = min(fresh)
            silent, name = self.mounts[self.leader].name, self.mounts[leader].name
            since = 1e3 * (time - heard[self.leader])
            notes.append(f"IMU {silent!r}: silent for {since:.0f} ms; {name!r} takes over")
        reading = last[leader]
        if reading is None:
            raise InvalidInputError(
                f"estimator: the first message has no usable reading of IMU"
                f" {self.mounts[leader].name!r} {notes or ''}"
            )
        if leader not in fresh and time - heard[leader] > QUIET:
            since = 1e3 * (time - heard[leader])
            notes.append(f"IMU {self.mounts[leader].name!r}: held for {since:.0f} ms")
        states = tuple(heard), tuple(last), tuple(same)
        watch = ImuWatch(self.mounts, self.timeout, leader, *states)
        scale = 1.0 if leader in fresh else GUESSED
        found = Inertial(
            reading.angular_velocity, reading.specific_force, scale, leader, tuple(notes)
        )
        return watch, found


def _same(a: ImuReading, b: ImuReading) -> bool:
    return (
        a.angular_velocity.tobytes() == b.angular_velocity.tobytes()
        and a.specific_force.tobytes() == b.specific_force.tobytes()
    )
