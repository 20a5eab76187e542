"""The range of footsteps that legs can make; checks prescribed ones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

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
from wbc.polygon import convex_hull, polygon_margin
from wbc.robot import Robot
from wbc.run.phase_support import Ground
from wbc.validate import Array, list_of

# Shortest swing, as a ratio of the nominal one, and longest, in 1/omega: the capture point's
# error grows by e in each 1/omega.
MIN_SINGLE_RATIO, MAX_SINGLE = 0.45, 10.0
# Steepest ground of a footstep, rise over run.
MAX_SLOPE = 0.35
# Tolerance at the edge of a range.
ROUNDING = 1e-9


class Complaint(NamedTuple):
    """Why footstep ``number``, counted from 0, is out of range, by its key."""

    number: int
    key: str
    text: str


@dataclass(frozen=True)
class StepRange:
    """The range of footsteps of a robot."""

    gait: GaitSettings
    limits: CommandLimits
    legs: Legs
    corners: Mapping[str, Array]  # of the soles (k, 2) by foot, in its axes [m]

    @classmethod
    def of(cls, robot: Robot, gait: GaitSettings, legs: Legs) -> Self:
        """Return the range of a robot with a gait and these legs."""
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
        """Return footsteps in the world, all of them in range.

        ``feet``: poses of the feet, (x, y, yaw, z) by foot.
        ``first``: the foot that has to begin, if any.
        ``relative``: whether each is relative to the one before, the first to its stance foot.
        ``ground``: heights of the ground, if known.

        Raises InvalidInputError: none at all; the same foot twice; one out of reach, in too short a
        time, across the other foot or on it: the message names the value and its range.
        """
        world = list_of("footsteps", footsteps, Footstep, 'Footstep("left", 0.2, 0.1)')
        if not world:
            raise InvalidInputError("footsteps: none are given; give at least one, or stop")
        if switch("footsteps, relative", relative):
            world = in_world(world, feet)
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
        """Yield what is out of range of footsteps in the world; see :meth:`admitted`."""
        poses = dict(feet)
        swing = first
        for number, step in enumerate(world):
            if swing is not None and step.foot != swing:
                stance = "stands next" if number == 0 else "has just landed"
                yield Complaint(number, "foot", f"the {step.foot} one {stance}; it must be {swing}")
                return  # the same would be said of all that follow
            stance = other(step.foot)
            for key, text in self._check_reach(step, poses[stance], poses[step.foot], ground):
                yield Complaint(number, key, text)
            poses[step.foot] = step.pose(float(poses[stance][3]))
            swing = stance

    def crossing(
        self, step: Footstep, base: Array, before: Array, ground: Ground | None
    ) -> Crossing | None:
        """Return the path over edges from ``before``, past a foot at ``base``; None without any.

        Poses are (x, y, yaw, z). Edges are known from the footstep's height or the ground only.
        """
        if step.z is None and ground is None:
            return None
        stance_height, goal = float(base[3]), step.pose(float(base[3]))
        corners = self.corners[step.foot]
        return Crossing.over(before, goal, corners, self.gait.clearance, stance_height, ground)

    def _check_reach(
        self, step: Footstep, base: Array, before: Array, ground: Ground | None
    ) -> Iterator[tuple[str, str]]:
        """Yield keys and texts of a step from ``before`` beside a foot at ``base``."""
        local, stance = step.seen_from(base), other(step.foot)
        lateral = SIGN[step.foot] * local.y
        min_width, width_range = self.gait.least_width, self.limits.apart - self.gait.width
        lateral_share = max(lateral - self.gait.width, 0.0) / width_range
        if lateral < min_width - ROUNDING:
            what = "across it" if lateral <= 0.0 else "too near"
            yield (
                "y",
                f"{lateral:.3g} m beside the {stance} foot, on its own side, is {what}:"
                f" {min_width:.3g} (gait.least_width) to {self.limits.apart:.3g} m",
            )
        elif lateral_share > 1.0 + ROUNDING:
            yield (
                "y",
                f"{lateral:.3g} m beside the {stance} foot is out of reach of the legs:"
                f" {min_width:.3g} to {self.limits.apart:.3g} m",
            )
        else:
            ahead = self.limits.step * math.sqrt(max(1.0 - lateral_share * lateral_share, 0.0))
            if abs(local.x) > ahead + ROUNDING:
                yield (
                    "x",
                    f"{local.x:.3g} m ahead of the {stance} foot is out of reach of the legs, as"
                    f" far beside it as this is: {-ahead:.3g} to {ahead:.3g} m",
                )
        turn = self.limits.turn
        if abs(local.yaw) > turn + ROUNDING:
            yield (
                "yaw",
                f"{local.yaw:.3g} rad from the {stance} foot is out of reach of the hips:"
                f" {-turn:.3g} to {turn:.3g} rad",
            )
        elif lateral > 0.0 and self._overlap(step.foot, local):
            yield (
                "yaw",
                f"the sole would stand on that of the {stance} foot, {lateral:.3g} m beside it and"
                f" turned by {local.yaw:.3g} rad; turn it less, or go farther aside",
            )
        rise = abs(local.z or 0.0)
        hip = math.sqrt(max((STRETCH * self.legs.length) ** 2 - (0.5 * local.x) ** 2, 0.0))
        max_rise = max(hip - self.legs.bearing_length, 0.0)
        if rise > max_rise + ROUNDING:
            yield (
                "z",
                f"{local.z:.3g} m over the {stance} foot is out of reach of the legs, as far ahead"
                f" as this is: {-max_rise:.3g} to {max_rise:.3g} m",
            )
        if step.z is not None and ground is not None:
            below = float(heights(ground, step.place[None])[0])
            if abs(step.z - below) > self.gait.clearance:
                yield (
                    "z",
                    f"{step.z:.3g} m in the world, but the ground that is given is at {below:.3g} m"
                    f" there; they may be {self.gait.clearance:.3g} m apart (gait.clearance)",
                )
        if step.slope is not None and math.hypot(*step.slope) > MAX_SLOPE:
            yield (
                "slope",
                f"{math.hypot(*step.slope):.3g} is steeper than soles hold: at most {MAX_SLOPE:g}",
            )
        yield from self._check_time(step, before, self.crossing(step, base, before, ground))

    def _check_time(
        self, step: Footstep, before: Array, crossing: Crossing | None
    ) -> Iterator[tuple[str, str]]:
        """Yield keys and texts where the step from ``before`` takes more time than it has."""
        T = step.single(self.gait)
        shortest, longest = MIN_SINGLE_RATIO * self.gait.single, MAX_SINGLE / self.gait.omega
        if not shortest <= T <= longest:
            yield "duration", f"{T:.3g} s on one foot; {shortest:.3g} to {longest:.3g} s"
            return
        # Over edges the horizontal motion takes a part of the time only.
        ahead = T if crossing is None else T * (1.0 - crossing.begins - crossing.ends)
        # The pelvis moves by half of the distance, in the whole step.
        per_rate = PEAK / ahead - 0.5 / (T + self.gait.double)
        distances = {
            "speed of the hips": self.legs.swing_speed / per_rate,
            "torque of the hips": self.legs.swing_acceleration * ahead**2 / PEAK_ACCELERATION,
        }
        why = min(distances, key=lambda key: distances[key])
        distance = float(np.linalg.norm(step.place - before[:2]))
        if distance > distances[why] + ROUNDING:
            yield (
                "duration",
                f"the foot goes {distance:.3g} m in {T:.3g} s, beyond the {why}: at most"
                f" {distances[why]:.3g} m in that time",
            )
        turn = math.remainder(step.yaw - before[2], math.tau)
        max_turn = self.legs.turn_speed / per_rate
        if abs(turn) > max_turn + ROUNDING:
            yield (
                "duration",
                f"the foot turns by {turn:.3g} rad in {T:.3g} s, beyond the speed at which hips"
                f" turn: at most {max_turn:.3g} rad in that time",
            )

    def _overlap(self, foot: str, step: Footstep) -> bool:
        """Return whether the sole at ``step`` lies over the other one (Minkowski difference)."""
        own = self.corners[foot] @ turned(step.yaw)[:2, :2].T + step.place
        apart = (own[:, None] - self.corners[other(foot)]).reshape(-1, 2)
        return bool(polygon_margin(convex_hull(apart), np.zeros(2)) > ROUNDING)
