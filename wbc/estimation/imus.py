"""Where IMUs are on a robot, and what they can measure."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from wbc.kinds import check_word
from wbc.robot.mounted import Mount, mount
from wbc.validate import check_fields


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
        check_word("IMU, name", self.name)
        check_fields(self, f"IMU {self.name!r}, ", "most_rate", "most_force", above=0.0)
        _ = self.mount

    @property
    def mount(self) -> Mount:
        """Its frame, position and rotation, checked."""
        return mount(f"IMU {self.name!r}", self.frame, self.position, self.rotation)
