"""What footsteps legs can make of those that are given."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from wbc.constraints import Limits
from wbc.errors import InvalidInputError
from wbc.gait.command import PEAK_ACCELERATION, CommandLimits
from wbc.gait.crossing import Crossing, heights
from wbc.gait.footsteps import SIGN, other
from wbc.gait.legs import STRETCH, Legs
from wbc.gait.prescribed_steps import Footstep, in_world
from wbc.gait.settings import GaitSettings
from wbc.gait.swing import turned
from wbc.kinds import switch
from wbc.minimum_jerk import PEAK
from wbc.polygon import half_planes
from wbc.robot import Robot
from wbc.run.phase_support import Ground
from wbc.validate import Array

# The time in the air may shrink to this part of what is usual, and last so long, in 1/omega: what
# is not known of the capture point grows by e in each 1/omega.
SHORTEST, LONGEST_STAND = 0.45, 10.0
# Steepest ground that a foot is sent to, rise over run.
STEEPEST = 0.35
# Rounding, of what is at the very edge of its range.
ROUNDING = 1e-9


class Complaint(NamedTuple):
    """What of footstep ``number``, counted from 0, cannot be, by its key."""

    number: int
    key: str
    text: str


@dataclass(frozen=True)
class StepRange:
    """What footsteps a robot can make.

    Attributes
    ----------
    corners:
        Of the soles (k, 2) by foot, in its axes [m].
    """

    gait: GaitSettings
    limits: CommandLimits
    legs: Legs
    corners: Mapping[str, Array]

    @classmethod
    def of(cls, robot: Robot, gait: GaitSettings, limits: Limits | None = None) -> Self:
        """Return it for a robot that walks so, its joints within limits, if any are given."""
        legs = Legs.of(robot, limits)
        corners = {foot: sole.polygon for foot, sole in robot.feet.items()}
        return cls(gait, CommandLimits.of(legs, gait), legs, corners)

    def admitted(
        self,
        footsteps: Sequence[Footstep],
        feet: Mapping[str, Array],
        first: str | None = None,
        *,
        relative: bool = False,
        ground: Ground | None = None,
    ) -> tuple[Footstep, ...]:
        """Return footsteps in the world, all of which can be made.

        Parameters
        ----------
        feet:
            Where feet are, (x, y, yaw, z) by foot.
        first:
            The foot that has to begin, if any.
        relative:
            Whether each is relative to the one before, the first to the foot that stands then.
        ground:
            Over which feet go, if it is known.

        Raises
        ------
        InvalidInputError
            None at all; the same foot twice; one out of reach, in too short a time, across the
            other foot or on it: the message names the value and its range.
        """
        if isinstance(footsteps, str) or not isinstance(footsteps, Sequence):
            raise InvalidInputError(f"footsteps: expected a list of them, got {footsteps!r}")
        for one in footsteps:
            if not isinstance(one, Footstep):
                raise InvalidInputError(f"footsteps: expected Footstep(foot, x, y), got {one!r}")
        if not footsteps:
            raise InvalidInputError("footsteps: none are given; give at least one, or stop")
        told = switch("footsteps, relative", relative)
        world = in_world(footsteps, feet) if told else tuple(footsteps)
        for number, key, text in self.complaints(world, feet, first, ground):
            raise InvalidInputError(f"footstep {number + 1} ({world[number].foot}), {key}: {text}")
        return world

    def complaints(
        self,
        world: Sequence[Footstep],
        feet: Mapping[str, Array],
        first: str | None = None,
        ground: Ground | None = None,
    ) -> Iterator[Complaint]:
        """Yield what of footsteps in the world cannot be; see :meth:`admitted`."""
        where = dict(feet)
        lifts = first
        for number, step in enumerate(world):
            if lifts is not None and step.foot != lifts:
                stands = "stands next" if number == 0 else "has just landed"
                yield Complaint(number, "foot", f"the {step.foot} one {stands}; it must be {lifts}")
                return  # all that follows would be complained about too
            stands = other(step.foot)
            for key, text in self._of_one(step, where[stands], where[step.foot], ground):
                yield Complaint(number, key, text)
            where[step.foot] = step.pose(float(where[stands][3]))
            lifts = stands

    def crossing(
        self, step: Footstep, base: Array, before: Array, ground: Ground | None
    ) -> Crossing | None:
        """Return how a foot goes over edges from ``before`` beside a foot at ``base``, if any.

        Poses are (x, y, yaw, z). Without a height and a ground that is known there are none.
        """
        if step.z is None and ground is None:
            return None
        beside, goal = float(base[3]), step.pose(float(base[3]))
        corners = self.corners[step.foot]
        return Crossing.over(before, goal, corners, self.gait.clearance, beside, ground)

    def _of_one(
        self, step: Footstep, base: Array, before: Array, ground: Ground | None
    ) -> Iterator[tuple[str, str]]:
        """Yield keys and texts of one that goes from ``before`` beside a foot at ``base``."""
        seen, stands = step.seen_from(base), other(step.foot)
        beside = SIGN[step.foot] * seen.y
        least, wide = self.gait.least_width, self.limits.apart - self.gait.width
        far = max(beside - self.gait.width, 0.0) / wide
        if beside < least - ROUNDING:
            what = "across it" if beside <= 0.0 else "too near"
            yield (
                "y",
                f"{beside:.3g} m beside the {stands} foot, on its own side, is {what}:"
                f" {least:.3g} (gait.least_width) to {self.limits.apart:.3g} m",
            )
        elif far > 1.0 + ROUNDING:
            yield (
                "y",
                f"{beside:.3g} m beside the {stands} foot is out of reach of the legs:"
                f" {least:.3g} to {self.limits.apart:.3g} m",
            )
        else:
            ahead = self.limits.step * math.sqrt(max(1.0 - far * far, 0.0))
            if abs(seen.x) > ahead + ROUNDING:
                yield (
                    "x",
                    f"{seen.x:.3g} m ahead of the {stands} foot is out of reach of the legs, as far"
                    f" beside it as this is: {-ahead:.3g} to {ahead:.3g} m",
                )
        turn = self.limits.turn
        if abs(seen.yaw) > turn + ROUNDING:
            yield (
                "yaw",
                f"{seen.yaw:.3g} rad from the {stands} foot is out of reach of the hips:"
                f" {-turn:.3g} to {turn:.3g} rad",
            )
        elif beside > 0.0 and self._overlap(step.foot, seen):
            yield (
                "yaw",
                f"the sole would stand on that of the {stands} foot, {beside:.3g} m beside it and"
                f" turned by {seen.yaw:.3g} rad; turn it less, or go farther aside",
            )
        rise = abs(seen.z or 0.0)
        hip = math.sqrt(max((STRETCH * self.legs.length) ** 2 - (0.5 * seen.x) ** 2, 0.0))
        most = max(hip - self.legs.bearing_length, 0.0)
        if rise > most + ROUNDING:
            yield (
                "z",
                f"{seen.z:.3g} m over the {stands} foot is out of reach of the legs, as far ahead"
                f" as this is: {-most:.3g} to {most:.3g} m",
            )
        if step.z is not None and ground is not None:
            below = float(heights(ground, step.place[None])[0])
            if abs(step.z - below) > self.gait.clearance:
                yield (
                    "z",
                    f"{step.z:.3g} m in the world, but the ground that is given is at {below:.3g} m"
                    f" there; they may be {self.gait.clearance:.3g} m apart (gait.clearance)",
                )
        if step.slope is not None and math.hypot(*step.slope) > STEEPEST:
            yield (
                "slope",
                f"{math.hypot(*step.slope):.3g} is steeper than soles hold: at most {STEEPEST:g}",
            )
        yield from self._of_time(step, before, self.crossing(step, base, before, ground))

    def _of_time(
        self, step: Footstep, before: Array, crossing: Crossing | None
    ) -> Iterator[tuple[str, str]]:
        """Yield what does not fit the time in which a foot goes from ``before``."""
        T = step.single(self.gait)
        least, most = SHORTEST * self.gait.single, LONGEST_STAND / self.gait.omega
        if not least <= T <= most:
            yield "duration", f"{T:.3g} s on one foot; {least:.3g} to {most:.3g} s"
            return
        # Over edges a foot goes ahead in a part of the time only, and rises in half of it.
        ahead = T if crossing is None else T * (1.0 - crossing.begins - crossing.ends)
        # The pelvis goes half of the way with it, in the whole step.
        per_rate = PEAK / ahead - 0.5 / (T + self.gait.double)
        ways = {
            "speed of the hips": self.legs.swing_speed / per_rate,
            "torque of the hips": self.legs.swing_acceleration * ahead**2 / PEAK_ACCELERATION,
        }
        why = min(ways, key=lambda key: ways[key])
        way = float(np.linalg.norm(step.place - before[:2]))
        if way > ways[why] + ROUNDING:
            yield (
                "duration",
                f"the foot goes {way:.3g} m in {T:.3g} s, beyond the {why}: at most"
                f" {ways[why]:.3g} m in that time",
            )
        turn, able = math.remainder(step.yaw - before[2], math.tau), self.legs.turn_speed / per_rate
        if abs(turn) > able + ROUNDING:
            yield (
                "duration",
                f"the foot turns by {turn:.3g} rad in {T:.3g} s, beyond the speed at which hips"
                f" turn: at most {able:.3g} rad in that time",
            )

    def _overlap(self, foot: str, seen: Footstep) -> bool:
        """Return whether the sole at ``seen`` lies over the other one (separating axes)."""
        mine = self.corners[foot] @ turned(seen.yaw)[:2, :2].T + seen.place
        theirs = self.corners[other(foot)]
        apart = [(mine, theirs), (theirs, mine)]
        return not any(
            np.any((corners @ normals.T - offsets).min(axis=0) >= 0.0)
            for corners, (normals, offsets) in ((a, half_planes(b)) for a, b in apart)
        )
