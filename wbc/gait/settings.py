"""The settings of a gait, by default from the robot's size."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Self

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait.dcm import StepTimes
from wbc.gait.legs import WALKING_STRETCH, Legs
from wbc.kinds import check_kind
from wbc.validate import check_fields, finite_number

# Largest height of the hip over the ankle for weak knees, as a ratio of the leg's length.
MAX_HIP_RATIO = 0.97
# Times in units of the pendulum's time constant 1/omega, lengths in units of the CoM's height.
# A swing foot's peak acceleration goes with the inverse square of the swing time, and its moment
# moves the CoP: so double support is short.
SINGLE, DOUBLE, RAMP, CLEARANCE = 1.56, 0.16, 0.08, 0.09
# Lateral gap between the soles: smallest, and nominal, for inward recovery steps.
MIN_SOLE_GAP, SOLE_GAP = 0.04, 0.12
# Longest step, in 1/omega: rounding errors have grown by e^50 then, 5e21.
MAX_STEP_TIME = 50.0
# Acceleration of the commanded velocity, in units of gravity, for a CoM at 1 m.
SPEED_UP = 0.08


@dataclass(frozen=True)
class GaitSettings:
    """How a robot walks; :meth:`of` fits all that is not given to the robot.

    Attributes
    ----------
    single, double:
        How long it stands on one foot, and then on both [s].
    height:
        Of the CoM over the soles [m].
    width:
        Distance of the feet from each other [m].
    least_width:
        Least that a recovery step may leave of it [m].
    clearance:
        How high feet are lifted [m].
    gain:
        How far beyond the capture point the pressure goes, by its error; see
        :meth:`wbc.laws.AccelerationLaw.capture_point`.
    ramp:
        How long a foot takes to bear its load and to give it up [s].
    acceleration:
        At which the commanded velocity is followed [m/s^2].
    gravity:
        The robot's own [m/s^2].
    """

    single: float
    double: float
    height: float
    width: float
    least_width: float
    clearance: float
    ramp: float
    acceleration: float
    gravity: float
    gain: float = 2.0

    def __post_init__(self) -> None:
        check_fields(self, "gait, ", *(one.name for one in fields(self)), above=0.0)
        if self.double < self.ramp:
            raise InvalidInputError(
                f"gait, ramp: {self.ramp:g} s is longer than the double support, {self.double:g} s"
            )
        if self.single < self.ramp:
            raise InvalidInputError(
                f"gait, single: {self.single:g} s is shorter than a foot takes to bear its load;"
                f" give at least {self.ramp:g} s (ramp)"
            )
        max_time = MAX_STEP_TIME / self.omega
        if self.single + self.double > max_time:
            raise InvalidInputError(
                f"gait, single: {self.single:g} s and double: {self.double:g} s are too long for a"
                f" step: errors of the capture point grow by e in each {1.0 / self.omega:.2g} s;"
                f" give at most {max_time:.3g} s together"
            )
        if self.least_width > self.width:
            raise InvalidInputError(
                f"gait, least_width: {self.least_width:g} m is above the width, {self.width:g} m"
            )

    @classmethod
    def of(cls, legs: Legs, **given: float | None) -> Self:
        """Return the settings for legs; what is None or left out gets the default.

        Raises
        ------
        UnknownNameError
            No such setting.
        InvalidInputError
            A value out of range, such as a time of 0 s; or legs do not reach the ground.
        """
        check_kind("gait, legs", legs, Legs, "Legs.of(robot)")
        names = [one.name for one in fields(cls) if one.name != "gravity"]
        for name in given:
            if name not in names:
                raise UnknownNameError("setting of a gait", name, names)
        chosen = {
            key: finite_number(f"gait, {key}", value, above=0.0)
            for key, value in given.items()
            if value is not None
        }
        height = chosen.setdefault("height", default_height(legs))
        width = chosen.setdefault("width", max(legs.width, legs.sole_width + SOLE_GAP * height))
        widest = legs.width + 2.0 * legs.reach(height)  # which raises where there is none
        if width > widest:
            raise InvalidInputError(
                f"gait, width: feet {width:g} m from each other are out of reach of the legs; give"
                f" at most {widest:.3g} m, or a lower height"
            )
        for key in ("width", "least_width"):
            if chosen.get(key, widest) < legs.sole_width:
                raise InvalidInputError(
                    f"gait, {key}: feet {chosen[key]:g} m from each other would stand on one"
                    f" another; give at least {legs.sole_width:.3g} m, the width of a sole"
                )
        finite_number("gait, gravity", legs.gravity, above=0.0)
        omega = math.sqrt(legs.gravity / height)
        chosen.setdefault("single", SINGLE / omega)
        chosen.setdefault("double", DOUBLE / omega)
        chosen.setdefault("ramp", min(RAMP / omega, chosen["double"]))
        narrow = legs.sole_width + MIN_SOLE_GAP * height
        chosen.setdefault("least_width", min(narrow, width))
        lift = 0.5 * chosen["single"] * legs.lift_speed  # what slow knees can lift
        chosen.setdefault("clearance", min(CLEARANCE * height, lift))
        if chosen["clearance"] > legs.length:
            raise InvalidInputError(
                f"gait, clearance: feet {chosen['clearance']:g} m above the ground would be above"
                f" the hips; give less than {legs.length:.3g} m"
            )
        chosen.setdefault("acceleration", SPEED_UP * legs.gravity * math.sqrt(height))
        return cls(**chosen, gravity=legs.gravity)

    @cached_property
    def times(self) -> StepTimes:
        """Of a step."""
        return StepTimes(self.single, self.double)

    @cached_property
    def omega(self) -> float:
        """Of the pendulum [1/s]."""
        return math.sqrt(self.gravity / self.height)


def default_height(legs: Legs) -> float:
    """Return a height of the CoM with bent knees [m], at most that of the standing posture.

    It is raised until one knee can bear the robot, as far as the leg's length allows.
    """
    hip = min(WALKING_STRETCH * legs.length, legs.hip_height)
    hip = max(hip, min(legs.bearing_length, MAX_HIP_RATIO * legs.length))
    return legs.com_height + hip - legs.hip_height
