"""Gait settings that follow the speed: at high speed a lower CoM and quicker steps.

The reach of the legs at the CoM's height limits the steps and so the speed
(:class:`~wbc.gait.command.CommandLimits`); at that limit a G1 with its usual settings falls. Lower,
its legs reach farther, and quicker steps are shorter at the same speed. Both cost robustness where
they are not needed: so they are blended in with the speed, from step to step.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from wbc.gait.command import CommandLimits
from wbc.gait.reference import StepPlanner
from wbc.gait.whole_body import WalkingWeights

# Speeds at which blending begins and is complete, as ratios of the usual settings' limit. The
# second is the new limit.
ONSET, FULL = 0.9, 1.075
# Reductions of height and single support there, as ratios of the usual ones. A G1 needs both to
# walk at 1.2 m/s: without the first its legs are stretched, without the second its hips are at
# their bounds.
HEIGHT_REDUCTION, TIME_REDUCTION = 0.05, 0.12
# Factors there of the swing foot's weights for place and height. At usual speed the first would
# cost robustness to pushes from behind: a fast foot takes torque from the CoP. At three times the
# height's weight (180 in place of 60) one of two walks at 1.2 m/s fell.
SWING_FACTOR, LIFT_FACTOR = 3.0, 2.0 / 3.0
REACH_LIMIT = "reach of the legs"


@dataclass(frozen=True)
class Pace:
    """The step planner for one speed, and the swing foot's weights.

    ``planner``: with the settings of the gait.
    ``swing``, ``lift``: weights of the swing foot (:class:`~wbc.gait.whole_body.WalkingWeights`).
    """

    planner: StepPlanner
    swing: float
    lift: float


@dataclass(frozen=True)
class Paces:
    """The paces of a walker.

    ``usual``, ``fastest``: up to :data:`ONSET` of the usual limit, and from :data:`FULL` of it on.
    They are the same where something else than the legs' reach limits the speed, where knees could
    not bear the robot lower, or where height or single support are given.
    ``begins``, ``ends``: these two speeds, forwards or backwards [m/s].
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

        ``given``: names of the settings that the user gave.
        """
        gait, limits, legs = planner.gait, planner.limits, planner.legs
        usual = Pace(planner, weights.swing, weights.lift)
        begins, ends = ONSET * limits.forwards, FULL * limits.forwards
        lower = gait.height * (1.0 - HEIGHT_REDUCTION)
        hip_height = legs.hip_height + lower - legs.com_height
        can_adapt = limits.why[0] == REACH_LIMIT and hip_height >= legs.bearing_length
        if not can_adapt or {"height", "single"} & set(given):
            return cls(usual, usual, begins, limits.forwards)
        fast_gait = replace(gait, height=lower, single=gait.single * (1.0 - TIME_REDUCTION))
        fast_limits = CommandLimits.of(legs, fast_gait)
        if fast_limits.forwards < ends:
            return cls(usual, usual, begins, limits.forwards)
        fast = Pace(
            replace(planner, gait=fast_gait, limits=fast_limits),
            SWING_FACTOR * weights.swing,
            LIFT_FACTOR * weights.lift,
        )
        return cls(usual, fast, begins, ends)

    @property
    def limits(self) -> CommandLimits:
        """The largest velocities, each with its pace."""
        return replace(self.usual.planner.limits, forwards=self.ends)

    def at(self, speed: float) -> Pace:
        """Return the pace at a speed forwards or backwards [m/s]."""
        share = (abs(speed) - self.begins) / (self.ends - self.begins)
        if self.fastest is self.usual or share <= 0.0:
            return self.usual
        if share >= 1.0:
            return self.fastest
        usual, fastest = self.usual, self.fastest

        def blend(a: float, b: float) -> float:
            return a + share * (b - a)

        slow, fast = usual.planner.gait, fastest.planner.gait
        gait = replace(
            slow, height=blend(slow.height, fast.height), single=blend(slow.single, fast.single)
        )
        limits = CommandLimits.of(usual.planner.legs, gait)
        planner = replace(usual.planner, gait=gait, limits=limits)
        return Pace(planner, blend(usual.swing, fastest.swing), blend(usual.lift, fastest.lift))
