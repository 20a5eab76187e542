"""Prescribed footsteps: where each foot goes, where it landed, and the DCM between."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np

from wbc.gait.command import Velocity
from wbc.gait.dcm import StepTimes, dcm_offsets, shift_gain
from wbc.gait.footsteps import SIGN, other
from wbc.gait.legs import SIDES
from wbc.gait.settings import GaitSettings
from wbc.gait.swing import turned, unit
from wbc.kinds import one_of
from wbc.validate import Array, check_fields, finite_number, finite_vector, set_fields

# Duration of the first and the last weight shift, in units of 1/omega.
WEIGHT_SHIFT = 1.2
# Steps of the preview; each later one counts for exp(-omega T), some 1/6, of the one before.
HORIZON = 6
# Shortest time in which the heading follows the feet [s].
MIN_TURN_TIME = 0.1


@dataclass(frozen=True)
class Footstep:
    """Where a foot goes.

    Attributes
    ----------
    foot:
        ``left`` or ``right``.
    x, y:
        Of the middle of its sole [m].
    yaw:
        Heading of the sole, to the left [rad].
    duration:
        How long the other foot stands alone meanwhile [s]; None: as the gait has it.
    z:
        Height of the sole's middle [m]; None: of the measured ground.
    slope:
        (2,) of the ground below it, rise over run along the axes that x and y are in; None: that of
        the measured ground, or level, if z is given.
    """

    foot: str
    x: float
    y: float
    yaw: float = 0.0
    duration: float | None = None
    z: float | None = None
    slope: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        one_of("foot", self.foot, SIDES)
        check_fields(self, "footstep, ", "x", "y", "yaw")
        if self.duration is not None:
            finite_number("footstep, duration", self.duration, above=0.0)
        if self.z is not None:
            finite_number("footstep, z", self.z)
        if self.slope is not None:
            x, y = finite_vector("footstep, slope", self.slope, 2).tolist()
            set_fields(self, slope=(x, y))

    @property
    def place(self) -> Array:
        """Of the sole (2,) [m]."""
        return np.array((self.x, self.y))

    @property
    def normal(self) -> Array | None:
        """Unit normal (3,) of the ground below it; None if it is not given."""
        if self.z is None and self.slope is None:
            return None
        x, y = self.slope or (0.0, 0.0)
        return unit(np.array((-x, -y, 1.0)))

    def pose(self, height: float) -> Array:
        """Return x, y, yaw and z (4,) [m, rad]; z is ``height`` if it is not given."""
        return np.array((self.x, self.y, self.yaw, height if self.z is None else self.z))

    def seen_from(self, base: Array) -> Self:
        """Return it relative to a foot at ``base`` (x, y, yaw, z)."""
        seen = self._moved(-float(base[2]), self.place - base[:2], -float(base[3]))
        return replace(seen, yaw=math.remainder(seen.yaw, math.tau))

    def carried_to(self, base: Array) -> Self:
        """Return it in the world, if it is relative to a foot at ``base`` (x, y, yaw, z)."""
        moved = self._moved(float(base[2]), self.place, float(base[3]))
        return replace(moved, x=moved.x + float(base[0]), y=moved.y + float(base[1]))

    def _moved(self, turn: float, place: Array, rise: float) -> Self:
        """Return it at ``place`` (2,), turned about the vertical and raised."""
        R = turned(turn)[:2, :2]
        x, y = (R @ place).tolist()
        z = None if self.z is None else self.z + rise
        slope = None if self.slope is None else tuple((R @ self.slope).tolist())
        return replace(self, x=x, y=y, yaw=self.yaw + turn, z=z, slope=slope)

    def single(self, gait: GaitSettings) -> float:
        """Return how long the other foot stands alone [s]."""
        return gait.single if self.duration is None else self.duration


class Landing(NamedTuple):
    """How far a foot landed from its footstep, as measured at touch-down.

    Attributes
    ----------
    footstep:
        In the world.
    distance:
        Over the ground [m].
    turn:
        About the vertical [rad].
    height:
        Over the footstep's z, if that was given [m].
    """

    footstep: Footstep
    distance: float
    turn: float
    height: float = 0.0

    @classmethod
    def of(cls, footstep: Footstep, pose: Array) -> Self:
        """Return the landing of a foot at ``pose`` (x, y, yaw, z)."""
        distance = float(np.linalg.norm(pose[:2] - footstep.place))
        turn, above = math.remainder(pose[2] - footstep.yaw, math.tau), footstep.pose(pose[3])[3]
        return cls(footstep, distance, abs(turn), float(pose[3] - above))


def in_world(footsteps: Sequence[Footstep], feet: Mapping[str, Array]) -> tuple[Footstep, ...]:
    """Return footsteps in the world, each of which is given relative to the one before."""
    placed, base = list[Footstep](), feet[other(footsteps[0].foot)]
    for step in footsteps:
        placed.append(step.carried_to(base))
        base = placed[-1].pose(float(base[3]))
    return tuple(placed)


def prescribed_dcm_offsets(
    base: complex, steps: Sequence[Footstep], gait: GaitSettings
) -> tuple[complex, complex]:
    """Return the DCM relative to the foot at ``base``, and to the first footstep.

    Each at the beginning of that foot's single support, x + i y [m]. After the last footstep the
    VRP moves to the middle between the feet, and the DCM comes to rest there; in a walk that goes
    on, the first is ((1 + alpha) d + b) exp(-omega T) of the second, b (:mod:`wbc.gait.dcm`).
    """
    horizon, last = steps[:HORIZON], 0j
    places = [base, *(complex(step.x, step.y) for step in horizon)]
    displacements = [end - begin for begin, end in pairwise(places)]
    if len(horizon) == len(steps):  # the DCM as the VRP leaves the last but one foot
        dcm_at_departure = 0.5 * displacements[-1] * -math.expm1(-WEIGHT_SHIFT) / WEIGHT_SHIFT
        dcm_at_end = math.exp(gait.omega * gait.double) * dcm_at_departure
        last = dcm_at_end - shift_gain(gait.omega, gait.double) * displacements[-1]
    times = [StepTimes(step.single(gait), gait.double) for step in horizon]
    here, there, *_ = dcm_offsets(displacements, times, gait.omega, last)
    return here, there


def velocity_for(
    base: Array, step: Footstep, heading: float, left: float, gait: GaitSettings
) -> Velocity:
    """Return the velocity of a footstep beside a foot at ``base`` (x, y, yaw, z).

    The middle between the feet moves by the step less the gait's width; the heading is the mean of
    the feet's after the time ``left`` [s].
    """
    goal = float(base[2]) + 0.5 * math.remainder(step.yaw - float(base[2]), math.tau)
    turn = math.remainder(goal - heading, math.tau) / max(left, MIN_TURN_TIME)
    x, y = (turned(-heading)[:2, :2] @ (step.place - base[:2])).tolist()
    T = step.single(gait) + gait.double
    return Velocity(x / T, (y - SIGN[step.foot] * gait.width) / T, turn)
