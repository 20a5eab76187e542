"""What the CoM and the next footstep should be, by the phase of the walk and the DCM measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wbc.gait.adaptation import Reach, StepBounds, StepPlan, adapt_step
from wbc.gait.command import CommandLimits, Velocity
from wbc.gait.dcm import VrpSegment, shift_gain
from wbc.gait.footsteps import SIGN, Footsteps, other
from wbc.gait.phases import DoubleSupport, Measured, Phase, SingleSupport
from wbc.gait.settings import GaitSettings
from wbc.gait.swing import turned
from wbc.robot.legs import Legs
from wbc.validate import Array

# The time in the air may shrink and grow to these parts of it.
SHORTEST, LONGEST = 0.45, 1.3
# How much of the hips' acceleration a foot in the air may count on when it must hurry: more than
# all, as pelvis and trunk give way too. Of 100 N pushes on a G1 those towards the standing foot are
# lost at 0.5.
HASTE = 1.5
# How far in the sole the pressure may be counted on, in parts of its half size.
SOLE_SHARE = 0.6
# A step that is shorter than this part of its usual time had to hurry.
HURRIED = 0.9
# Nearer to the landing than this, in units of 1/omega, a footstep is not changed any more.
DECIDED = 0.15


class Reference(NamedTuple):
    """Where the pressure and the DCM should be (2,) [m], and how high the ground is [m]."""

    vrp: Array
    dcm: Array
    ground: float


@dataclass(frozen=True)
class StepPlanner:
    """Plans from the phase of a walk; keeps nothing.

    Attributes
    ----------
    soles:
        Half sizes (2,) of the soles by foot [m].
    """

    gait: GaitSettings
    limits: CommandLimits
    legs: Legs
    soles: dict[str, Array]

    @property
    def footsteps(self) -> Footsteps:
        """Where feet go."""
        return Footsteps(self.gait)

    def standing(self, now: Measured) -> Reference:
        """Return the reference of a robot that stands: between its feet."""
        middle = now.middle
        return Reference(middle[:2], middle[:2], float(middle[2]))

    def double(
        self, phase: DoubleSupport, now: Measured, heading: float, velocity: Velocity
    ) -> Reference:
        """Return the reference on both feet."""
        omega, left = self.gait.omega, max(phase.left, 0.0)
        new, old = now.places[phase.support], now.places[other(phase.support)]
        if phase.halts:
            end = last = now.middle[:2]
            ground = float(now.middle[2])
        else:
            end, ground = new[:2], float(new[2])
            ahead = heading + velocity.yaw_rate * left
            last = end + self.footsteps.offset(phase.support, ahead, velocity)
        segment = VrpSegment(phase.start, end, phase.duration)
        done = 1.0 - left / phase.duration
        return Reference(
            segment.at(phase.duration - left),
            segment.dcm_before(last, left, omega),
            (1.0 - done) * float(old[2]) + done * ground,
        )

    def single(self, phase: SingleSupport, now: Measured) -> Reference:
        """Return the reference on one foot: back from the footstep that is planned."""
        omega, double = self.gait.omega, self.gait.double
        foot = now.places[phase.support]
        base, step = foot[:2], phase.goal - foot[:2]
        shift = shift_gain(omega, double) * step + phase.offset
        leaving = math.exp(-omega * double) * shift  # the DCM when the VRP begins to move
        return Reference(
            base, base + math.exp(-omega * max(phase.left, 0.0)) * leaving, float(foot[2])
        )

    def sunk(self, phase: Phase, now: Measured, heading: float) -> float:
        """Return how much lower than usual the CoM should be [m].

        Where feet are far apart sideways, or will be, the leg behind reaches the ground from less
        height when the pelvis is over the other foot; stretched straight it would lift the pelvis.
        """
        feet = [now.places["left"][:2] - now.places["right"][:2]]
        if isinstance(phase, SingleSupport):
            feet.append(phase.goal - now.places[phase.support][:2])
        left = turned(heading)[:2, 1]
        apart = min(max(abs(float(left @ way)) for way in feet), self.limits.apart)
        height = self.legs.com_height_for(max(apart - self.legs.width, 0.0))
        return max(self.gait.height - height, 0.0)

    def double_time(self, phase: SingleSupport) -> float:
        """Return how long the double support lasts that ends a phase now [s].

        A foot that lands before its time waits, unless it had to hurry: then time is what lacks.
        """
        hurried = phase.elapsed + phase.left < HURRIED * self.gait.single
        early = 0.0 if hurried else min(max(phase.left, 0.0), self.gait.double)
        return self.gait.double + early

    def adapted(
        self, phase: SingleSupport, now: Measured, heading: float, velocity: Velocity
    ) -> SingleSupport:
        """Return the phase with the footstep for the DCM that is measured.

        Shortly before the landing a footstep stays as it is.
        """
        gait, omega, support = self.gait, self.gait.omega, phase.support
        soon = DECIDED / omega
        if phase.left <= soon:
            return phase
        base, R = now.places[support][:2], turned(heading)[:2, :2]
        began = heading - velocity.yaw_rate * phase.elapsed  # the heading of the standing foot
        landing = heading + velocity.yaw_rate * phase.left
        step = self.footsteps.step(support, began, velocity)
        offset = self.footsteps.offset(other(support), landing, velocity)
        nominal = StepPlan(
            R.T @ step, max(gait.single - phase.elapsed, soon), R.T @ offset, np.zeros(2)
        )
        sign, far = SIGN[other(support)], self.limits.step
        beside = sorted((sign * gait.least_width, sign * self.limits.apart))
        lower, upper = np.array((-far, beside[0])), np.array((far, beside[1]))
        level = phase.swing.level
        reach = Reach(
            R.T @ (level.value[:2] - base), R.T @ level.rate[:2], HASTE * self.limits.swing
        )
        least = max(soon, SHORTEST * gait.single - phase.elapsed, reach.least_time(lower, upper))
        most = max(least, LONGEST * gait.single - phase.elapsed)
        bounds = StepBounds(
            lower,
            upper,
            least,
            most,
            SOLE_SHARE * self.soles[support],
            reach,
            min(max(phase.left, least), most),
        )
        plan = adapt_step(R.T @ (now.dcm - base), nominal, bounds, omega, gait.double)
        return replace(phase, left=plan.left, goal=base + R @ plan.place, offset=R @ plan.offset)
