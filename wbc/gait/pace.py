"""Settings that follow the speed: a robot in a hurry walks lower, and with quicker steps.

A step is as long as the legs reach at the height of the CoM, and lasts as long as falling over it
takes. At what usual settings do of that (:class:`~wbc.gait.command.CommandLimits`) a G1 falls;
lower, its legs reach farther, and a shorter step needs less of that reach. Both cost robustness
where they are not needed: so they come with the speed, from step to step.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from wbc.gait.command import CommandLimits
from wbc.gait.reference import StepPlanner
from wbc.gait.whole_body import WalkingWeights

# From which part of the speed that usual settings reach others begin to come, and where they are
# all there, which is as fast as it goes.
BEGINS, FASTEST = 0.9, 1.075
# How much lower and quicker it then walks, in parts of the usual height and single support. By
# these a G1 walks at 1.2 m/s: without the one its legs are stretched, without the other its hips
# are at their bounds.
LOWER, QUICKER = 0.05, 0.12
# How much more the foot in the air weighs then in its place, and how much less in its height. In a
# usual walk the one costs pushes from behind: a foot that hurries takes the pressure's torque. At
# three times the height's weight (180 in place of 60) one of two walks at 1.2 m/s fell.
FIRM_PLACE, FIRM_LIFT = 3.0, 2.0 / 3.0
REACH = "reach of the legs"


@dataclass(frozen=True)
class Pace:
    """What plans steps at one speed, and the weights by which feet follow.

    Attributes
    ----------
    planner:
        With the settings of the gait.
    swing, lift:
        Weights of a foot in the air (:class:`~wbc.gait.whole_body.WalkingWeights`).
    """

    planner: StepPlanner
    swing: float
    lift: float


@dataclass(frozen=True)
class Paces:
    """The paces of a walker.

    Attributes
    ----------
    usual, fastest:
        Up to :data:`BEGINS` of the usual limit, and from :data:`FASTEST` of it on. They are the
        same where it is not the reach of the legs that limits the speed, where knees could not
        bear the robot lower, or where height and time on one foot are given.
    begins, ends:
        Speeds of both, forwards or backwards [m/s].
    """

    usual: Pace
    fastest: Pace
    begins: float
    ends: float

    @classmethod
    def of(
        cls, planner: StepPlanner, weights: WalkingWeights, given: Collection[str] = ()
    ) -> Paces:
        """Return the paces about a usual planner.

        Parameters
        ----------
        given:
            Names of the settings that were asked for, and stay.
        """
        gait, limits, legs = planner.gait, planner.limits, planner.legs
        usual = Pace(planner, weights.swing, weights.lift)
        begins, ends = BEGINS * limits.forwards, FASTEST * limits.forwards
        lower = gait.height * (1.0 - LOWER)
        hip = legs.hip_height + lower - legs.com_height
        follows = limits.why[0] == REACH and hip >= legs.bearing_length
        if not follows or {"height", "single"} & set(given):
            return cls(usual, usual, begins, limits.forwards)
        quick = replace(gait, height=lower, single=gait.single * (1.0 - QUICKER))
        able = CommandLimits.of(legs, quick)
        if able.forwards < ends:
            return cls(usual, usual, begins, limits.forwards)
        fast = Pace(
            replace(planner, gait=quick, limits=able),
            FIRM_PLACE * weights.swing,
            FIRM_LIFT * weights.lift,
        )
        return cls(usual, fast, begins, ends)

    @property
    def limits(self) -> CommandLimits:
        """The largest velocities, with the pace that each has."""
        return replace(self.usual.planner.limits, forwards=self.ends)

    def at(self, speed: float) -> Pace:
        """Return the pace at a speed forwards or backwards [m/s]."""
        share = (abs(speed) - self.begins) / (self.ends - self.begins)
        if self.fastest is self.usual or share <= 0.0:
            return self.usual
        if share >= 1.0:
            return self.fastest
        one, other = self.usual, self.fastest

        def between(a: float, b: float) -> float:
            return a + share * (b - a)

        slow, fast = one.planner.gait, other.planner.gait
        gait = replace(
            slow, height=between(slow.height, fast.height), single=between(slow.single, fast.single)
        )
        limits = CommandLimits.of(one.planner.legs, gait)
        planner = replace(one.planner, gait=gait, limits=limits)
        return Pace(planner, between(one.swing, other.swing), between(one.lift, other.lift))
