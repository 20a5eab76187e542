"""A walking command: a velocity, and its limits by the legs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from wbc.gait.legs import Legs
from wbc.gait.settings import GaitSettings
from wbc.minimum_jerk import PEAK
from wbc.validate import check_fields, finite_number

# Peak acceleration of a minimum-jerk curve, in units of distance / time^2: 10/sqrt(3).
PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
# Largest yaw between the feet [rad].
MAX_TURN = 0.5
# Lateral distance of the feet beyond the gait's width, in units of one leg's reach.
LATERAL_REACH = 1.5
# How far the CoM may sink in a recovery step, in units of the hip's height.
MAX_SINK = 0.03


class Velocity(NamedTuple):
    """Forwards and to the left [m/s], and about the vertical, to the left [rad/s]."""

    vx: float = 0.0
    vy: float = 0.0
    yaw_rate: float = 0.0

    @property
    def at_rest(self) -> bool:
        """Whether all are zero."""
        return self == (0.0, 0.0, 0.0)

    def towards(self, goal: Velocity, change: float, turn: float) -> Velocity:
        """Return the velocity nearest to ``goal`` within ``change`` [m/s] and ``turn`` [rad/s]."""
        dx, dy = goal.vx - self.vx, goal.vy - self.vy
        share = min(1.0, change / max(math.hypot(dx, dy), 1e-12))
        dyaw = goal.yaw_rate - self.yaw_rate
        yaw = goal.yaw_rate if abs(dyaw) <= turn else self.yaw_rate + math.copysign(turn, dyaw)
        if share == 1.0:
            return Velocity(goal.vx, goal.vy, yaw)
        return Velocity(self.vx + share * dx, self.vy + share * dy, yaw)


class Admitted(NamedTuple):
    """An admitted command, and why it is less than the given one; ``reason`` is empty if equal."""

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

    def __post_init__(self) -> None:
        check_fields(self, "walking limits, ", "forwards", "sideways", above=0.0)
        check_fields(self, "walking limits, ", "turning", least=0.0)

    @classmethod
    def of(cls, legs: Legs, gait: GaitSettings) -> CommandLimits:
        """Return the limits of legs with a gait.

        In a walk at v a foot goes 2 v T in the single support, on a minimum-jerk curve; it turns
        likewise.
        """
        T, reach = gait.times.total, legs.reach(gait.height)
        hip_height = legs.hip_height + gait.height - legs.com_height
        swing_ratio = 2.0 * T / gait.single
        forwards = {
            "reach of the legs": 2.0 * reach / T,
            "speed of the hips": legs.swing_speed / (PEAK * swing_ratio - 1.0),
            "torque of the hips": legs.swing_acceleration
            * gait.single
            / (PEAK_ACCELERATION * swing_ratio),
        }
        forwards_limit = min(forwards, key=lambda key: forwards[key])
        turn = min(MAX_TURN, legs.turn)
        turn_limit = "the feet in one step" if turn else "legs without a joint for it"
        turn_speeds = {
            f"turn of {turn_limit}": turn / T,
            "speed at which hips turn": legs.turn_speed / (PEAK * swing_ratio - 1.0),
        }
        slowest_turn = min(turn_speeds, key=lambda key: turn_speeds[key])
        max_width = gait.width + LATERAL_REACH * reach
        lateral = forwards | {"reach of the legs": LATERAL_REACH * reach / (2.0 * T)}
        lateral_limit = min(lateral, key=lambda key: lateral[key])
        return cls(
            forwards[forwards_limit],
            lateral[lateral_limit],
            turn_speeds[slowest_turn],
            (forwards_limit, lateral_limit, slowest_turn),
            2.0 * reach,
            max_width,
            turn,
            legs.swing_acceleration,
            2.0 * legs.reach(gait.height - MAX_SINK * hip_height),
            max(max_width, legs.width + 2.0 * reach),  # hips stand over feet
        )

    def admit(self, vx: float, vy: float, yaw_rate: float) -> Admitted:
        """Return the command scaled to what the legs can do.

        Forwards and sideways share the legs' reach: (vx/forwards)^2 + (vy/sideways)^2 <= 1.

        Raises
        ------
        InvalidInputError
            Not finite numbers.
        """
        vx = finite_number("walking command, vx", vx)
        vy = finite_number("walking command, vy", vy)
        w = finite_number("walking command, yaw_rate", yaw_rate)
        ratio = math.hypot(vx / self.forwards, vy / self.sideways)
        reasons = list[str]()
        if ratio > 1.0:
            why = self.why[0 if abs(vx) / self.forwards >= abs(vy) / self.sideways else 1]
            reasons.append(
                f"({vx:g}, {vy:g}) m/s is beyond the {why}: {vx / ratio:.3g}, {vy / ratio:.3g} m/s"
                f" (at most {self.forwards:.3g} forwards, {self.sideways:.3g} sideways)"
            )
            vx, vy = vx / ratio, vy / ratio
        if abs(w) > self.turning:
            reasons.append(f"{w:g} rad/s is beyond the {self.why[2]}: {self.turning:.3g} rad/s")
            w = math.copysign(self.turning, w)
        return Admitted(Velocity(vx, vy, w), "; ".join(reasons))
