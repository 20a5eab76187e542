"""What the CoM and the next footstep should be, by the phase of the walk and the DCM measured."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from wbc.gait.adaptation import WEIGHTS, Reach, StepBounds, StepPlan, StepWeights, adapt_step
from wbc.gait.command import CommandLimits, Velocity
from wbc.gait.dcm import VrpSegment, in_plane, shift_gain
from wbc.gait.footsteps import SIGN, Footsteps, other
from wbc.gait.legs import Legs
from wbc.gait.phases import DoubleSupport, GaitState, Phase, SingleSupport, landing_pose
from wbc.gait.prescribed_steps import Footstep, given_offsets, velocity_on
from wbc.gait.settings import GaitSettings
from wbc.gait.step_range import SHORTEST
from wbc.gait.swing import FootPose, yaw_of
from wbc.polygon import convex_hull, nearest_point
from wbc.robot import Robot
from wbc.validate import Array

# The time in the air may grow to this part of it.
LONGEST = 1.3
# How much of the hips' acceleration a foot in the air may count on when it must hurry: more than
# all, as pelvis and trunk give way too. Of 100 N pushes on a G1 those towards the standing foot are
# lost at 0.5.
HASTE = 1.5
# How far in the sole the pressure may be counted on, in parts of its half size.
SOLE_SHARE = 0.6
# A step that catches a push takes at least this part of its usual time, in which its foot is
# relieved and lifted; what its way takes follows from the acceleration. At 0.45 a G1 that is pushed
# towards the foot it has begun to stand on waits for the other one, which could be down.
QUICKEST = 0.2
# A step that is shorter than this part of its usual time had to hurry.
HURRIED = 0.9
# A foot that bears this part of the weight has landed.
TOUCH = 0.1
# Nearer to the landing than this, in units of 1/omega, a footstep is not changed any more.
DECIDED = 0.15
# A foot that is pressed has landed, if it has done so much of its way: what it bumps into before is
# an edge.
DONE = 0.7
# One that does not find the ground counts as landed so late, in units of 1/omega.
LATEST = 1.2
# A step at rest ends the walk if it is this near to its place [m].
BESIDE = 0.03
# Of a sole, in units of its half size.
CORNERS = np.array(((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)))
# A footstep that is given is left only where the sole and the time of the landing do not suffice.
GIVEN = StepWeights(place=100.0)


class Reference(NamedTuple):
    """Where the pressure and the DCM should be.

    Attributes
    ----------
    vrp, dcm:
        As x + i y [m].
    ground:
        How high the ground is where it is pressed [m].
    level:
        How high that is that the CoM's height is over [m], if footsteps have heights that are
        given; else it is ``ground``.
    within:
        In which time the CoM should be there [s]; None: as soon as it follows.
    """

    vrp: complex
    dcm: complex
    ground: float
    level: float | None = None
    within: float | None = None


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

    @cached_property
    def footsteps(self) -> Footsteps:
        """Where feet go."""
        return Footsteps(self.gait)

    def standing(self, now: GaitState) -> Reference:
        """Return the reference of a robot that stands: between its feet."""
        middle = in_plane(now.middle)
        return Reference(middle, middle, float(now.middle[2]))

    def double(
        self,
        phase: DoubleSupport,
        now: GaitState,
        heading: float,
        velocity: Velocity,
        coming: Sequence[Footstep] = (),
    ) -> Reference:
        """Return the reference on both feet; ``coming`` are footsteps that are given."""
        omega, left = self.gait.omega, max(phase.left, 0.0)
        new, old = now.places[phase.support], now.places[other(phase.support)]
        end, ground = now.place(phase.support), float(new[2])
        if phase.halts:
            end = last = in_plane(now.middle)
            ground = float(now.middle[2])
        elif coming:
            last = end + given_offsets(end, coming, self.gait)[0]
        else:
            ahead = heading + velocity.yaw_rate * left
            last = end + self.footsteps.offset(phase.support, ahead, velocity)
        segment = VrpSegment(phase.start, end, phase.duration)
        waits = max(left - phase.duration, 0.0)
        left -= waits
        done = 1.0 - left / phase.duration
        vrp = segment.at(phase.duration - left)
        dcm = segment.dcm_before(last, left, omega)
        return Reference(
            vrp,
            vrp + math.exp(-omega * waits) * (dcm - vrp) if waits else dcm,
            (1.0 - done) * float(old[2]) + done * ground,
            None if phase.halts else phase.level,
        )

    def single(self, phase: SingleSupport, now: GaitState) -> Reference:
        """Return the reference on one foot: back from the footstep that is planned."""
        base, ground = now.place(phase.support), float(now.places[phase.support][2])
        left = max(phase.left, 0.0)
        dcm = base + math.exp(-self.gait.omega * left) * self._leaving(phase, base)
        return Reference(base, dcm, ground, phase.level, left)

    def _leaving(self, phase: SingleSupport, base: complex) -> complex:
        """Return where the DCM should be, from the foot at ``base``, as the VRP leaves that [m]."""
        omega, double = self.gait.omega, self.gait.double
        shift = shift_gain(omega, double) * (phase.goal - base) + phase.offset
        return math.exp(-omega * double) * shift

    def sunk(self, phase: Phase, now: GaitState, heading: float) -> float:
        """Return how much lower than usual the CoM should be [m].

        Where feet are far apart sideways, or will be, the leg behind reaches the ground from less
        height when the pelvis is over the other foot; stretched straight it would lift the pelvis.
        In a step that is longer than in a walk both legs reach it from less when the pelvis is
        halfway.
        """
        ways = [now.place("left") - now.place("right")]
        if isinstance(phase, SingleSupport):
            ways.append(phase.goal - now.place(phase.support))
        back, found = cmath.rect(1.0, -heading), 0.0
        for way in ways:
            seen = way * back  # ahead + i beside
            halfway = 0.5 * min(abs(seen.real), self.limits.catch)
            wider = max(min(abs(seen.imag), self.limits.catch_aside) - self.legs.width, 0.0)
            height = self.legs.com_height_for(math.hypot(halfway, wider))
            found = max(found, self.gait.height - height)
        return found

    def single_time(self, phase: SingleSupport) -> float:
        """Return how long a phase should last [s]."""
        return phase.given[0].single(self.gait) if phase.given else self.gait.single

    def touches(self, phase: SingleSupport, load: float | None) -> bool:
        """Return whether the foot in the air, which bears this part of the weight, has landed.

        A slow one touches more softly, by the square of its speed. None: it does when it should.
        """
        if load is None:
            return phase.left <= 0.0
        pressed = load > TOUCH * min(1.0, self.gait.single / self.single_time(phase)) ** 2
        return (pressed and phase.swing.done > DONE) or phase.swing.late > LATEST / self.gait.omega

    def swung(
        self, phase: SingleSupport, now: GaitState, heading: float, velocity: Velocity, dt: float
    ) -> tuple[SingleSupport, FootPose]:
        """Return the phase with the foot in the air led on by ``dt``, and where that should be."""
        goal = landing_pose(phase, heading, velocity)
        ground = phase.given[0].z if phase.given else None
        if ground is None:
            x, y, z = phase.swing.normal.tolist()
            way = phase.goal - now.place(phase.support)
            ground = float(now.places[phase.support][2]) - (x * way.real + y * way.imag) / z
        swing = phase.swing.advanced(goal, ground, phase.left, dt)
        return phase._replace(swing=swing), swing.pose()

    def double_time(self, phase: SingleSupport, now: GaitState) -> float:
        """Return how long the double support lasts that ends a phase now [s].

        A foot that lands before its time, on higher ground, waits for the DCM to come as near as it
        does to where the VRP leaves the other foot, but no longer than until then. After a push
        aside that is sooner than ahead it is there: what goes aside grows as long as one waits. A
        step of a walk that had to hurry does not wait: time is what it lacks.
        """
        base = now.place(phase.support)
        leaving, there = self._leaving(phase, base), now.dcm - base
        grows = (leaving * there.conjugate()).real / max(abs(there) ** 2, 1e-12)
        lacks = math.log(grows) / self.gait.omega if grows > 1.0 else 0.0
        hurried = not phase.given and phase.elapsed + phase.left < HURRIED * self.single_time(phase)
        return self.gait.double + (0.0 if hurried else max(min(phase.left, lacks), 0.0))

    def velocity_on_steps(self, phase: Phase, now: GaitState, heading: float) -> Velocity | None:
        """Return the velocity of the footstep that is being made, if it was given."""
        if not (isinstance(phase, SingleSupport) and phase.given):
            return None
        left = max(phase.left, 0.0) + self.gait.double
        return velocity_on(now.pose(phase.support), phase.given[0], heading, left, self.gait)

    def at_its_end(
        self, phase: SingleSupport, now: GaitState, heading: float, velocity: Velocity
    ) -> bool:
        """Return whether a robot that is to stand can do so, as its foot lands."""
        if phase.given:
            return True
        start, place = now.place(phase.support), now.place(other(phase.support))
        nominal = start + self.footsteps.step(phase.support, heading, velocity)
        return velocity.at_rest and abs(place - nominal) < BESIDE

    def adapted(
        self, phase: SingleSupport, now: GaitState, heading: float, velocity: Velocity
    ) -> SingleSupport:
        """Return the phase with the footstep for the DCM that is measured.

        Shortly before the landing a footstep stays as it is; its ``adapted`` says whether that was
        the answer of a QP.
        """
        gait, omega, support = self.gait, self.gait.omega, phase.support
        soon = DECIDED / omega
        if phase.left <= soon:
            return phase
        base, single, double = now.place(support), self.single_time(phase), gait.double
        if phase.given:
            ahead, weights, step = yaw_of(now.rotations[support]), GIVEN, phase.given[0]
            to_next = complex(step.x, step.y) - base
            offset = given_offsets(base, phase.given, gait)[1]
        else:
            ahead, weights = heading, WEIGHTS
            began = heading - velocity.yaw_rate * phase.elapsed  # the heading of the standing foot
            landing = heading + velocity.yaw_rate * phase.left
            to_next = self.footsteps.step(support, began, velocity)
            offset = self.footsteps.offset(other(support), landing, velocity)
        turn = cmath.rect(1.0, ahead)
        back = turn.conjugate()  # to the axes of the foot that stands

        def seen(way: complex) -> tuple[float, float]:
            there = way * back
            return there.real, there.imag

        nominal = StepPlan(
            seen(to_next), max(single - phase.elapsed, soon), seen(offset), (0.0, 0.0)
        )
        sign, far = SIGN[other(support)], self.limits.catch
        beside = sorted((sign * gait.least_width, sign * self.limits.catch_aside))
        lower, upper = (-far, beside[0]), (far, beside[1])
        level, swing = phase.swing.level, HASTE * self.limits.swing
        reach = Reach(seen(in_plane(level.value) - base), seen(in_plane(level.rate)), swing)
        quickest = SHORTEST if phase.given else QUICKEST
        least = max(soon, quickest * single - phase.elapsed, reach.least_time(lower, upper))
        most = max(least, LONGEST * single - phase.elapsed)
        length, width = self.soles[support].tolist()
        length -= abs(now.ahead)
        sole, about = (SOLE_SHARE * length, SOLE_SHARE * width), min(max(phase.left, least), most)
        bounds = StepBounds(lower, upper, least, most, sole, reach, about)
        plan = adapt_step(seen(now.dcm - base), nominal, bounds, omega, double, weights)
        # Not the plan's own offset, which is where the DCM will be: what the step cannot catch
        # would be no error then, and the pressure would go back to the middle of the sole.
        return phase._replace(
            left=plan.left,
            goal=base + turn * complex(*plan.place),
            offset=offset,
            adapted=plan.adapted,
            multipliers=plan.multipliers,
        )

    def within(self, phase: Phase, vrp: complex, now: GaitState) -> complex:
        """Return the point nearest to ``vrp`` that can be pressed, on one sole or between two.

        About a point outside the moment of the forces would be least where there are none: led
        there by a push, a robot left the ground for the whole double support. What a foot that is
        being relieved can bear goes to zero, and so does what it adds to the other sole.
        """
        if isinstance(phase, SingleSupport):
            (a, b, _), (c, d, _), _ = now.rotations[phase.support].tolist()
            place = now.place(phase.support)
            x, y = (vrp - place).real, (vrp - place).imag
            x, y = phase.foothold.nearest(a * x + c * y, b * x + d * y)
            return place + complex(a * x + b * y, c * x + d * y)
        corners = {
            foot: place[:2] + (self.soles[foot] * CORNERS) @ now.rotations[foot][:2, :2].T
            for foot, place in now.places.items()
        }
        if isinstance(phase, DoubleSupport) and phase.unloading:
            end, old = now.places[phase.support][:2], other(phase.support)
            share = min(max(phase.left, 0.0) / self.gait.ramp, 1.0)
            corners[old] = end + share * (corners[old] - end)
        hull = convex_hull(np.concatenate(list(corners.values())))
        return in_plane(nearest_point(hull, np.array((vrp.real, vrp.imag))))


def half_sizes(robot: Robot) -> dict[str, Array]:
    """Return how far each sole reaches from its middle (2,) [m], the lesser of both ways."""
    return {
        name: np.minimum(foot.polygon.max(axis=0), -foot.polygon.min(axis=0))
        for name, foot in robot.feet.items()
    }
