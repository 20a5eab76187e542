"""Whether a robot sustains the speed at which it walks, judged while it walks.

The limits of a command are those of reach, and of speed and torque of the swinging hip
(:mod:`wbc.gait.command`): upper bounds. A robot may still be too weak for its speed. Then hips or
knees are at their torque limits for most of a step, or it goes slower or faster than commanded;
some steps later it falls, unless it slows down.
"""

from __future__ import annotations

from typing import NamedTuple, Self

# Time constant of the filter that gives the part of the time at torque limits, in units of 1/omega:
# most of a step. Above STRAIN the speed is not sustained: humanoids that walk at their limit stay
# below 0.45, those that fall are above it for two steps and more before.
FILTER_TIME, STRAIN = 1.0, 0.5
# The mean speed over a step may differ from those commanded in it and in the step before by this
# part, or by this part of sqrt(g h). In a turn, where steps of the outer foot are longer, also by
# this part of the feet's difference in speed.
DEVIATION, SMALL_DEVIATION, UNEVEN = 0.2, 0.05, 0.25
# Larger observed accelerations are pushes [g]. For PUSH_TIME after one, and for CHANGE_TIME after
# the start and each reduction, nothing is judged [1/omega].
PUSH, PUSH_TIME, CHANGE_TIME = 0.06, 6.0, 3.0


class SpeedMonitor(NamedTuple):
    """Judges the speed from the motors' torques, and from landing to landing.

    Velocities are forwards and to the left, as x + i y.

    ``omega``, ``gravity``: of the pendulum [1/s], and g [m/s^2].
    ``unjudged``: for how long nothing is judged yet [s].
    ``strain``: part of the time in which hips or knees are at torque limits, filtered.
    ``start``, ``duration``, ``commanded``: CoM at the last landing as x + i y, or None before the
    first [m]; time since then [s], and way commanded in it [m].
    ``before``: mean velocity commanded in the step before [m/s].
    """

    omega: float
    gravity: float
    unjudged: float
    strain: float = 0.0
    start: complex | None = None
    duration: float = 0.0
    commanded: complex = 0j
    before: complex = 0j

    @classmethod
    def of(cls, omega: float, gravity: float) -> Self:
        """Return the monitor of a robot that begins to walk."""
        return cls(omega, gravity, CHANGE_TIME / omega)

    def update(self, at_limit: bool, velocity: complex, push: float, dt: float) -> Self:
        """Return the monitor ``dt`` later.

        ``at_limit``: whether a hip or knee is at its torque limit.
        ``velocity``: commanded [m/s].
        ``push``: observed acceleration by external forces [m/s^2].
        """
        omega, gravity, unjudged, strain, start, duration, commanded, before = self
        quiet = PUSH_TIME / omega if push > PUSH * gravity else unjudged - dt
        strain += dt * omega / FILTER_TIME * (at_limit - strain)
        way = duration + dt, commanded + dt * velocity
        return type(self)(omega, gravity, max(quiet, 0.0), strain, start, *way, before)

    def land(self, com: complex) -> Self:
        """Return the monitor of the next step."""
        mean = self.commanded / self.duration
        return self._replace(start=com, duration=0.0, commanded=0j, before=mean)

    def reduced(self) -> Self:
        """Return the monitor after a reduction of the speed."""
        return self._replace(unjudged=CHANGE_TIME / self.omega)

    @property
    def is_strained(self) -> bool:
        """Whether hips or knees are at their torque limits for too long."""
        return self.strain > STRAIN and not self.unjudged

    def deviation(
        self, com: complex, ahead: complex, outer: float = 0.0, along: complex = 1.0
    ) -> float | None:
        """Return the speed of the step that ends [m/s] if it is not the commanded one, or None.

        ``com``, ``ahead``: CoM at the landing [m], and unit vector of the step's mean heading, as x
        + i y.
        ``outer``: how much faster the outer foot goes than the inner one [m/s].
        ``along``: the axis that is judged: 1 forwards, i to the left.
        """
        if self.start is None or self.unjudged:
            return None
        to_axis = along.conjugate()
        speed = ((com - self.start) * ahead.conjugate() * to_axis).real / self.duration
        told = self.before, self.commanded / self.duration
        least, most = sorted((velocity * to_axis).real for velocity in told)
        small, uneven = SMALL_DEVIATION * self.gravity / self.omega, UNEVEN * outer
        least -= max(DEVIATION * abs(least), small) + uneven
        most += max(DEVIATION * abs(most), small) + uneven
        return None if least <= speed <= most else speed
