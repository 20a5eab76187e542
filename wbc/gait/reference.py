"""The reference of VRP, DCM and next footstep, from the walk's phase and the measured DCM."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wbc.gait.adaptation import WEIGHTS, StepBounds, StepPlan, StepWeights, adapt_step
from wbc.gait.command import CommandLimits, Velocity
from wbc.gait.dcm import VrpSegment, in_plane, shift_gain
from wbc.gait.footsteps import nominal_offset, nominal_step, other
from wbc.gait.legs import Legs
from wbc.gait.phases import DoubleSupport, GaitState, Phase, SingleSupport
from wbc.gait.prescribed_steps import Footstep, prescribed_dcm_offsets, velocity_for
from wbc.gait.settings import GaitSettings
from wbc.gait.step_range import MIN_SINGLE_RATIO
from wbc.gait.swing import FootPose, yaw_of
from wbc.minimum_jerk import minimum_jerk
from wbc.polygon import convex_hull, nearest_point, polygon_margin
from wbc.robot import Robot
from wbc.validate import Array

# Longest swing, as a ratio of its nominal time.
MAX_TIME_RATIO = 1.3
# Largest acceleration of a swing foot in a recovery step, as a ratio of what the hips give: above
# 1, as pelvis and trunk yield, too. At 1.5 a G1 survives pushes from the sides that are smaller by
# an eighth, at 2.6 a TALOS ones from the front.
CATCH_ACCELERATION = 2.0
# Part of the sole's half size within which the planner places the CoP.
SOLE_SHARE = 0.6
# Shortest recovery step, as a ratio of the nominal swing time: unloading and lifting the foot; the
# time for its distance follows from the acceleration. At 0.45 a G1 that is pushed towards its new
# stance foot lands the other one later than it could.
MIN_TIME_RATIO = 0.2
# A step below this ratio of its nominal swing time is a recovery step.
SHORTENED_RATIO = 0.9
# A foot that bears this part of the weight has landed.
TOUCH_LOAD = 0.1
# The footstep is fixed for this time before touch-down, in units of 1/omega.
FREEZE_TIME = 0.15
# A loaded foot has landed from this part of its path on; before, it has hit an edge.
MIN_DONE = 0.7
# A foot farther than this from where it is to land has not [m]: held there, a G1 that was pushed
# over it just before survived 45 N s in place of 64. In fast walks this part of its usual way is
# more, which is what a foot has before it at MIN_DONE.
LANDING_DISTANCE, UNDONE = 0.1, 1.0 - minimum_jerk(MIN_DONE)
# A foot that finds no ground counts as landed after this delay, in units of 1/omega.
MAX_DELAY = 1.2
# A commanded stop ends the walk if the foot is this near to its nominal place [m].
HALT_DISTANCE = 0.03
# A prescribed footstep is left only where the sole and the time of landing do not suffice.
EXACT = StepWeights(place=100.0)


class Reference(NamedTuple):
    """The reference of VRP and DCM.

    ``vrp``, ``dcm``: as x + i y [m].
    ``ground``: height of the ground at the CoP [m].
    ``level``: height that the CoM's height is relative to [m], where footsteps prescribe heights;
    None: ``ground``.
    ``within``: time until the CoM should be at that height [s]; None: it follows as a spring.
    """

    vrp: complex
    dcm: complex
    ground: float
    level: float | None = None
    within: float | None = None


@dataclass(frozen=True)
class StepPlanner:
    """Plans from the phase of a walk; has no state."""

    gait: GaitSettings
    limits: CommandLimits
    legs: Legs
    soles: dict[str, Array]  # half sizes (2,) of the soles by foot [m]

    def standing(self, now: GaitState) -> Reference:
        """Return the reference while standing: the middle between the feet."""
        middle = in_plane(now.middle)
        return Reference(middle, middle, float(now.middle[2]))

    def double_support(
        self,
        phase: DoubleSupport,
        now: GaitState,
        heading: float,
        velocity: Velocity,
        coming: Sequence[Footstep] = (),
    ) -> Reference:
        """Return the reference in double support; ``coming`` are prescribed footsteps."""
        omega, left = self.gait.omega, max(phase.left, 0.0)
        new, old = now.places[phase.support], now.places[other(phase.support)]
        end, ground = now.place(phase.support), new[2]
        if phase.halts:
            end = last = in_plane(now.middle)
            ground = float(now.middle[2])
        elif coming:
            last = end + prescribed_dcm_offsets(end, coming, self.gait)[0]
        else:
            ahead = heading + velocity.yaw_rate * (left + 0.5 * self.gait.single)
            last = end + nominal_offset(self.gait, phase.support, ahead, velocity)
        segment = VrpSegment(phase.start, end, phase.duration)
        wait = max(left - phase.duration, 0.0)
        left -= wait
        progress = 1.0 - left / phase.duration
        vrp = segment.at(phase.duration - left)
        dcm = segment.dcm_before(last, left, omega)
        return Reference(
            vrp,
            vrp + math.exp(-omega * wait) * (dcm - vrp) if wait else dcm,
            (1.0 - progress) * old[2] + progress * ground,
            None if phase.halts else phase.level,
        )

    def single_support(self, phase: SingleSupport, now: GaitState) -> Reference:
        """Return the reference in single support: back in time from the planned footstep."""
        base, ground = now.place(phase.support), now.places[phase.support][2]
        left = max(phase.left, 0.0)
        dcm = base + math.exp(-self.gait.omega * left) * self._departing_dcm(phase, base)
        return Reference(base, dcm, ground, phase.level, left)

    def _departing_dcm(self, phase: SingleSupport, base: complex) -> complex:
        """Return the DCM relative to the foot at ``base`` when the VRP leaves it [m]."""
        omega, double = self.gait.omega, self.gait.double
        shift = shift_gain(omega, double) * (phase.goal - base) + phase.offset
        return math.exp(-omega * double) * shift

    def height_reduction(self, phase: Phase, now: GaitState, heading: float) -> float:
        """Return how far the CoM should sink below the gait's height [m].

        Where feet are, or will be, far apart sideways, the trailing leg must reach the ground with
        the pelvis over the other foot; stretched straight it would lift the pelvis. In a long step
        both legs must reach it with the pelvis halfway.
        """
        separations = [now.place("left") - now.place("right")]
        if isinstance(phase, SingleSupport):
            separations.append(phase.goal - now.place(phase.support))
        to_heading, farthest, limits = cmath.rect(1.0, -heading), 0.0, self.limits
        for separation in separations:
            local = separation * to_heading  # x forwards, y to the left
            halfway = 0.5 * min(abs(local.real), limits.catch)
            excess_width = max(min(abs(local.imag), limits.catch_aside) - self.legs.width, 0.0)
            farthest = max(farthest, math.hypot(halfway, excess_width))
        return max(0.0, self.gait.height - self.legs.com_height_for(farthest))

    def single_time(self, phase: SingleSupport) -> float:
        """Return the nominal duration of a single support [s]."""
        return phase.given[0].single(self.gait) if phase.given else self.gait.single

    def has_landed(self, phase: SingleSupport, load: float | None, velocity: Velocity) -> bool:
        """Return whether the swing foot, which bears ``load`` (part of the weight), has landed.

        The threshold falls with the square of the speed. A foot whose goal was moved away as it
        came down touches the ground on its way there. None: it lands as planned.
        """
        if load is None:
            return phase.left <= 0.0
        if phase.swing.late > MAX_DELAY / self.gait.omega:
            return True
        single = self.single_time(phase)
        pressed = load > TOUCH_LOAD * min(1.0, self.gait.single / single) ** 2
        if not (pressed and phase.swing.done > MIN_DONE):
            return False
        usual = 2.0 * math.hypot(velocity.vx, velocity.vy) * (single + self.gait.double)
        return abs(phase.goal - phase.swing.place) < max(LANDING_DISTANCE, UNDONE * usual)

    def landing_pose(
        self, phase: SingleSupport, now: GaitState, heading: float, velocity: Velocity
    ) -> tuple[float, float, float]:
        """Return x, y [m] and yaw [rad] of the swing foot's landing.

        A foot faces as the robot does half way through the time that it will stand alone, within
        what legs turn: where a turn begins or ends, the other one is set for another rate.
        """
        x, y = phase.goal.real, phase.goal.imag
        if phase.given:
            return x, y, phase.given[0].yaw
        yaw, stands = self._next_heading(phase, heading, velocity), now.rotations[phase.support]
        most = self.limits.turn or math.pi  # legs without a joint for it face ahead
        turn = math.remainder(yaw - yaw_of(stands), math.tau)
        return x, y, yaw - math.copysign(max(abs(turn) - most, 0.0), turn)

    def feet_after(
        self, phase: Phase, now: GaitState, heading: float, velocity: Velocity
    ) -> dict[str, Array]:
        """Return x, y, yaw and z of both feet (4,) [m, rad], of a swing foot where it lands."""
        feet = {foot: now.pose(foot) for foot in now.places}
        if isinstance(phase, SingleSupport):
            lands = self.landing_pose(phase, now, heading, velocity)
            height = feet[phase.support][3]
            if phase.given and phase.given[0].z is not None:
                height = phase.given[0].z
            feet[other(phase.support)] = np.append(lands, height)
        return feet

    def _next_heading(self, phase: SingleSupport, heading: float, velocity: Velocity) -> float:
        """Return the heading half way through the next single support [rad]."""
        ahead = max(phase.left, 0.0) + self.gait.double + 0.5 * self.gait.single
        return heading + velocity.yaw_rate * ahead

    def advance_swing(
        self, phase: SingleSupport, now: GaitState, heading: float, velocity: Velocity, dt: float
    ) -> tuple[SingleSupport, FootPose]:
        """Return the phase ``dt`` later, and the swing foot's reference."""
        most = CATCH_ACCELERATION * self.limits.swing
        if phase.swing.late and not phase.given:
            phase = phase._replace(goal=self._late_goal(phase, now, heading, most, dt))
        goal = self.landing_pose(phase, now, heading, velocity)
        ground = phase.given[0].z if phase.given else None
        if ground is None:
            x, y, z = phase.swing.normal.tolist()
            step = phase.goal - now.place(phase.support)
            ground = now.places[phase.support][2] - (x * step.real + y * step.imag) / z
        swing = phase.swing.advance(goal, ground, phase.left, dt, most)
        return phase._replace(swing=swing), swing.pose()

    def _late_goal(
        self, phase: SingleSupport, now: GaitState, heading: float, most: float, dt: float
    ) -> complex:
        """Return where a foot lands that finds lower ground, ``dt`` later, as x + i y [m].

        It goes on to where the DCM, which diverges meanwhile, can leave as planned; its speed rises
        by ``most`` [m/s^2]. Where it only went down, at 1.2 m/s a G1 fell at drops of 2 cm.
        """
        base, to_world = now.place(phase.support), cmath.rect(1.0, heading)
        omega, double = self.gait.omega, self.gait.double
        leaves = math.exp(omega * double) * (now.dcm - base) - phase.offset
        local = leaves / (shift_gain(omega, double) * to_world)
        lower, upper = self._range_of_steps(phase.support)
        x = min(max(local.real, lower[0]), upper[0])
        y = min(max(local.imag, lower[1]), upper[1])
        way = base + complex(x, y) * to_world - phase.goal
        return phase.goal + way * min(1.0, most * phase.swing.late * dt / max(abs(way), 1e-9))

    def _range_of_steps(self, support: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the least and largest x, y [m] of a recovery step from a foot, in its axes."""
        ahead, near, far = self.limits.catch, self.gait.least_width, self.limits.catch_aside
        least, widest = (near, far) if support == "right" else (-far, -near)
        return (-ahead, least), (ahead, widest)

    def double_time(self, phase: SingleSupport, now: GaitState) -> float:
        """Return the duration of the double support after a touch-down now [s].

        A foot that lands early, on higher ground, waits until the DCM is nearest to where it should
        be when the VRP leaves the old foot, at most until the planned touch-down. A lateral error
        grows meanwhile, so that after a lateral push the nearest point comes sooner. A recovery
        step of a commanded walk does not wait.
        """
        base = now.place(phase.support)
        wanted, actual = self._departing_dcm(phase, base), now.dcm - base
        growth = (wanted * actual.conjugate()).real / max(abs(actual) ** 2, 1e-12)
        missing = math.log(growth) / self.gait.omega if growth > 1.0 else 0.0
        time = phase.elapsed + phase.left
        recovers = not phase.given and time < SHORTENED_RATIO * self.single_time(phase)
        return self.gait.double + (0.0 if recovers else max(min(phase.left, missing), 0.0))

    def velocity_on_steps(self, phase: Phase, now: GaitState, heading: float) -> Velocity | None:
        """Return the velocity of the present footstep, if it is prescribed."""
        if not (isinstance(phase, SingleSupport) and phase.given):
            return None
        left = max(phase.left, 0.0) + self.gait.double
        return velocity_for(now.pose(phase.support), phase.given[0], heading, left, self.gait)

    def can_halt(
        self, phase: SingleSupport, now: GaitState, heading: float, velocity: Velocity
    ) -> bool:
        """Return whether the walk can end at this touch-down, at a stop or on the last footstep.

        On prescribed footsteps it can where the DCM is over the soles: it may be on its way to the
        next one, or pushed beyond them.
        """
        if phase.given:
            hull = _hull(self._corners(now, SOLE_SHARE))
            return bool(polygon_margin(hull, (now.dcm.real, now.dcm.imag)) >= 0.0)
        start, place = now.place(phase.support), now.place(other(phase.support))
        nominal = start + nominal_step(self.gait, phase.support, heading, velocity)
        return velocity.at_rest and abs(place - nominal) < HALT_DISTANCE

    def adapt(
        self, phase: SingleSupport, now: GaitState, heading: float, velocity: Velocity
    ) -> SingleSupport:
        """Return the phase with its footstep adapted to the measured DCM.

        Shortly before touch-down it is unchanged. Its ``adapted`` says whether the last QP was
        solved.
        """
        gait, omega, support = self.gait, self.gait.omega, phase.support
        freeze = FREEZE_TIME / omega
        if phase.left <= freeze:
            return phase
        base, single, double = now.place(support), self.single_time(phase), gait.double
        if phase.given:
            yaw, weights, step = yaw_of(now.rotations[support]), EXACT, phase.given[0]
            to_next = complex(step.x, step.y) - base
            offset = prescribed_dcm_offsets(base, phase.given, gait)[1]
        else:
            yaw, weights = heading, WEIGHTS
            stance_heading = heading + velocity.yaw_rate * (0.5 * single - phase.elapsed)
            next_heading = self._next_heading(phase, heading, velocity)
            to_next = nominal_step(gait, support, stance_heading, velocity)
            offset = nominal_offset(gait, other(support), next_heading, velocity)
        rotation = cmath.rect(1.0, yaw)
        to_stance = rotation.conjugate()  # to the axes of the stance foot

        def local(vector: complex) -> tuple[float, float]:
            seen = vector * to_stance
            return seen.real, seen.imag

        nominal = StepPlan(
            local(to_next), max(single - phase.elapsed, freeze), local(offset), (0.0, 0.0)
        )
        lower, upper = self._range_of_steps(support)
        foot, most = phase.swing, CATCH_ACCELERATION * self.limits.swing
        min_ratio = MIN_SINGLE_RATIO if phase.given else MIN_TIME_RATIO
        min_time = max(freeze, min_ratio * single - phase.elapsed)
        max_time = MAX_TIME_RATIO * single - phase.elapsed
        reach = local(foot.place - base), local(foot.speed), most, phase.left
        length, width = self.soles[support].tolist()
        length -= abs(now.pressure_offset)
        sole = SOLE_SHARE * length, SOLE_SHARE * width
        bounds = StepBounds(lower, upper, min_time, max_time, sole, *reach)
        plan = adapt_step(local(now.dcm - base), nominal, bounds, omega, double, weights)
        # The nominal offset, not the plan's, which is where the DCM will be: a part that the step
        # cannot capture would be no error then, and the CoP would go back to the sole's middle.
        return phase._replace(
            left=plan.left,
            goal=base + rotation * complex(*plan.place),
            offset=offset,
            adapted=plan.adapted,
            multipliers=plan.multipliers,
        )

    def project_onto_support(self, phase: Phase, vrp: complex, now: GaitState) -> complex:
        """Return the point of the support polygon, or of the foothold, nearest to ``vrp``.

        About a point outside, the moment of the contact forces is least for zero forces: asked for
        such a CoP after a push, a robot left the ground for the whole double support. The part of a
        foot that is being unloaded shrinks to zero with its force limit.
        """
        if isinstance(phase, SingleSupport):
            (a, b, _), (c, d, _), _ = now.rotations[phase.support]
            place = now.place(phase.support)
            x, y = (vrp - place).real, (vrp - place).imag
            x, y = phase.foothold.nearest(a * x + c * y, b * x + d * y)
            return place + complex(a * x + b * y, c * x + d * y)
        corners = self._corners(now)
        if isinstance(phase, DoubleSupport) and phase.unloading:
            end, old = now.place(phase.support), other(phase.support)
            share = min(max(phase.left, 0.0) / self.gait.ramp, 1.0)
            corners[old] = [end + share * (corner - end) for corner in corners[old]]
        return in_plane(nearest_point(_hull(corners), np.array((vrp.real, vrp.imag))))

    def _corners(self, now: GaitState, share: float = 1.0) -> dict[str, list[complex]]:
        """Return the corners (4,) of a ``share`` of each sole, x + i y [m], by foot."""
        found = {}
        for foot, rotation in now.rotations.items():
            (a, b, _), (c, d, _), _ = rotation
            length, width = self.soles[foot].tolist()
            ahead, aside = share * length * complex(a, c), share * width * complex(b, d)
            ways, place = (ahead + aside, aside - ahead), now.place(foot)
            found[foot] = [place + sign * way for way in ways for sign in (1.0, -1.0)]
        return found


def _hull(corners: dict[str, list[complex]]) -> Array:
    return convex_hull([(p.real, p.imag) for sole in corners.values() for p in sole])


def sole_half_sizes(robot: Robot) -> dict[str, Array]:
    """Return the smaller half length and half width of each sole (2,) [m]."""
    return {
        name: np.minimum(foot.polygon.max(axis=0), -foot.polygon.min(axis=0))
        for name, foot in robot.feet.items()
    }
