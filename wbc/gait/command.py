"""What a robot is asked to do: a velocity, and what its legs can do of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from wbc.gait.legs import Legs
from wbc.gait.settings import GaitSettings
from wbc.minimum_jerk import PEAK
from wbc.validate import finite_number

# Largest acceleration on the minimum-jerk way, over distance by time squared: 10/sqrt(3).
PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
# Feet are turned against each other by this much at most in a step [rad].
MOST_TURN = 0.5
# How much further than the reach of one leg feet may be apart sideways: the hips are in between.
SIDEWAYS = 1.5
# So far the CoM may sink for a step that catches a push, in parts of the hip's height.
SINK = 0.03


class Velocity(NamedTuple):
    """Forwards and to the left [m/s], and about the vertical, to the left [rad/s]."""

    vx: float = 0.0
    vy: float = 0.0
    yaw_rate: float = 0.0

    @property
    def at_rest(self) -> bool:
        """Whether it asks for nothing."""
        return self == (0.0, 0.0, 0.0)

    def towards(self, goal: Velocity, change: float, turn: float) -> Velocity:
        """Return the velocity nearest to ``goal`` within ``change`` [m/s] and ``turn`` [rad/s]."""
        if goal == self:
            return goal
        dx, dy = goal.vx - self.vx, goal.vy - self.vy
        share = min(1.0, change / max(math.hypot(dx, dy), 1e-12))
        rest = goal.yaw_rate - self.yaw_rate
        yaw = goal.yaw_rate if abs(rest) <= turn else self.yaw_rate + math.copysign(turn, rest)
        if share == 1.0:
            return Velocity(goal.vx, goal.vy, yaw)
        return Velocity(self.vx + share * dx, self.vy + share * dy, yaw)


class Admitted(NamedTuple):
    """What is left of a command, and why; ``reason`` is empty if all of it."""

    velocity: Velocity
    reason: str


@dataclass(frozen=True)
class CommandLimits:
    """Largest velocities that legs allow with the steps of a gait.

    Attributes
    ----------
    forwards, sideways:
        [m/s], either way.
    turning:
        [rad/s], either way.
    why:
        What limits them, in words.
    step:
        Longest step [m].
    apart:
        Farthest that feet are apart sideways [m].
    turn:
        Farthest that feet are turned against each other, either way [rad].
    swing:
        Largest acceleration of a foot in the air [m/s^2].
    catch:
        Longest step that catches a push, for which the CoM sinks [m].
    catch_aside:
        Farthest that feet are apart sideways in such a step: as far as both legs reach from a
        pelvis half way [m].
    """

    forwards: float
    sideways: float
    turning: float
    why: tuple[str, str, str]
    step: float
    apart: float
    turn: float
    swing: float
    catch: float
    catch_aside: float

    @classmethod
    def of(cls, legs: Legs, gait: GaitSettings) -> CommandLimits:
        """Return the limits of legs that walk so.

        In a walk at v a foot goes 2 v T in the single support, on a minimum-jerk way; likewise it
        turns.
        """
        T, reach = gait.times.total, legs.reach(gait.height)
        hip = legs.hip_height + gait.height - legs.com_height
        per_speed = 2.0 * T / gait.single
        able = {
            "reach of the legs": 2.0 * reach / T,
            "speed of the hips": legs.swing_speed / (PEAK * per_speed - 1.0),
            "torque of the hips": legs.swing_acceleration
            * gait.single
            / (PEAK_ACCELERATION * per_speed),
        }
        limiting = min(able, key=lambda key: able[key])
        turn = min(MOST_TURN, legs.turn)
        what = "the feet in one step" if turn else "legs without a joint for it"
        turning = {
            f"turn of {what}": turn / T,
            "speed at which hips turn": legs.turn_speed / (PEAK * per_speed - 1.0),
        }
        slowest = min(turning, key=lambda key: turning[key])
        apart = gait.width + SIDEWAYS * reach
        sideways = able | {"reach of the legs": SIDEWAYS * reach / (2.0 * T)}
        least = min(sideways, key=lambda key: sideways[key])
        return cls(
            able[limiting],
            sideways[least],
            turning[slowest],
            (limiting, least, slowest),
            2.0 * reach,
            apart,
            turn,
            legs.swing_acceleration,
            2.0 * legs.reach(gait.height - SINK * hip),
            max(apart, legs.width + 2.0 * reach),  # hips stand over feet
        )

    def admit(self, vx: float, vy: float, yaw_rate: float) -> Admitted:
        """Return the velocity in the direction of the command that legs can do.

        Forwards and sideways share the legs' reach: (vx/forwards)^2 + (vy/sideways)^2 <= 1.

        Raises
        ------
        InvalidInputError
            Not finite numbers.
        """
        vx = finite_number("walking command, vx", vx)
        vy = finite_number("walking command, vy", vy)
        w = finite_number("walking command, yaw_rate", yaw_rate)
        use = math.hypot(vx / self.forwards, vy / self.sideways)
        told = list[str]()
        if use > 1.0:
            why = self.why[0 if abs(vx) / self.forwards >= abs(vy) / self.sideways else 1]
            told.append(
                f"({vx:g}, {vy:g}) m/s is beyond the {why}: {vx / use:.3g}, {vy / use:.3g} m/s"
                f" (at most {self.forwards:.3g} forwards, {self.sideways:.3g} sideways)"
            )
            vx, vy = vx / use, vy / use
        if abs(w) > self.turning:
            told.append(f"{w:g} rad/s is beyond the {self.why[2]}: {self.turning:.3g} rad/s")
            w = math.copysign(self.turning, w)
        return Admitted(Velocity(vx, vy, w), "; ".join(told))
