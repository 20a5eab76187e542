"""Rounds of a closed joint path: a Fourier series, from rest to rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError
from wbc.kinds import whole_number
from wbc.minimum_jerk import minimum_jerk, minimum_jerk_rates
from wbc.robot import Robot
from wbc.robot.chains import followers
from wbc.robot.limits import BASE_NV
from wbc.validate import Array, finite_array, finite_number, read_only

DIGITS = 5  # of coefficients in a file: 1e-5 rad turns a robot by less than that
ROUNDING = 1e-4  # rad or m beyond a limit, which that may put the end of a path
CHECK_PHASES = 400  # at which a path is checked


def harmonics(phases: Array, count: int, derivative: int = 0) -> Array:
    """Return cos(h p) - 1 for h = 1..count, then sin(h p), at phases (n,): (n, 2 count).

    Or a derivative by the phase p. All are zero at p = 0, where the path begins at its start.
    """
    h = np.arange(1, count + 1)
    angle = np.outer(phases, h) + 0.5 * np.pi * derivative
    start = 1.0 if derivative == 0 else 0.0
    factor = h.astype(float) ** derivative
    return np.hstack((factor * np.cos(angle) - start, factor * np.sin(angle)))


def even_phases(count: int) -> Array:
    """Return even phases (n,), the midpoints of n parts of a round."""
    return 2.0 * np.pi * (np.arange(count) + 0.5) / count


@dataclass(frozen=True, eq=False)
class JointLoop:
    """A closed path, over phases from 0 to 2 pi."""

    start: Array  # (k,) joints at phase 0 [rad or m]
    coefficients: Array  # (2 h, k) of :func:`harmonics`

    def at(self, phases: Array, derivative: int = 0) -> Array:
        """Return the joints (n, k) at phases (n,), or a derivative by the phase."""
        values = harmonics(phases, len(self.coefficients) // 2, derivative) @ self.coefficients
        return np.asarray(values + self.start if derivative == 0 else values)


@dataclass(frozen=True, eq=False)
class Rounds:
    """Rounds of a closed path of all joints, from rest to rest: a posture task's trajectory.

    Attributes
    ----------
    robot:
        The robot.
    posture:
        (nq,) at which it begins and ends.
    coefficients:
        (2 h, nv-6) of the :class:`JointLoop`.
    cycles:
        Number of rounds.
    period:
        Mean duration of a round [s]; the phase follows a minimum-jerk ramp over all of them.

    Raises
    ------
    InvalidInputError
        Coefficients of another shape, no whole number of cycles, or no time.
    """

    robot: Robot
    posture: Array
    coefficients: Array
    cycles: int
    period: float

    def __post_init__(self) -> None:
        shape = (np.shape(self.coefficients)[0] // 2 * 2, self.robot.nv - BASE_NV)
        finite_array("rounds, coefficients", self.coefficients, shape)
        whole_number("rounds, cycles", self.cycles, least=1)
        finite_number("rounds, period", self.period, above=0.0)

    @classmethod
    def of(
        cls,
        robot: Robot,
        posture: Array,
        loop: Mapping[str, Sequence[float]],
        cycles: int,
        period: float,
    ) -> Rounds:
        """Return rounds of some joints; others are constant, but for those that follow these.

        Parameters
        ----------
        loop:
            Coefficients by joint, first of cosines, then of as many sines; the same number for each
            joint.

        Raises
        ------
        UnknownNameError
            No such joint.
        InvalidInputError
            Numbers of coefficients that differ, or are odd; a mimic joint that leaves its gear; a
            joint that leaves its limits.
        """
        sizes = {len(one) for one in loop.values()}
        if len(sizes) != 1 or min(sizes) % 2 or not min(sizes):
            raise InvalidInputError(
                "loop: each joint needs as many numbers, an even one: of cosines, then of sines;"
                f" got {sorted(sizes)}"
            )
        coefficients = np.zeros((sizes.pop(), robot.nv - BASE_NV))
        for name, values in loop.items():
            coefficients[:, robot.joint_index(name) - BASE_NV] = values
        for own, driver, gear in followers(robot):
            name = robot.joint_names[own]
            follows = gear.ratio * coefficients[:, driver]
            apart = np.abs(coefficients[:, own] - follows).max()
            if name in loop and apart > 2.0 * 10.0**-DIGITS * max(1.0, abs(gear.ratio)):
                text = f"loop: {name} follows {gear.driver}, by {gear.ratio:g} of its way"
                raise InvalidInputError(f"{text}; leave it out")
            if not gear.is_linear and coefficients[:, driver].any():
                raise InvalidInputError(
                    f"loop: {gear.driver} moves {name} by a curve; leave it out"
                )
            coefficients[:, own] = follows
        rounds = cls(robot, posture, read_only(coefficients), cycles, period)
        rounds._check_range()
        return rounds

    def _check_range(self) -> None:
        """Refuse a path that limits would cut, so that another rotation would be left."""
        limits, path = self.robot.limits, self.loop.at(even_phases(CHECK_PHASES))
        lowest, highest = path.min(axis=0), path.max(axis=0)
        beyond = np.maximum(limits.lower - lowest, highest - limits.upper)
        beyond[~self.coefficients.any(axis=0)] = 0.0  # a joint that rests is where it was put
        k = int(beyond.argmax())
        if beyond[k] > ROUNDING:
            end = lowest[k] if lowest[k] < limits.lower[k] else highest[k]
            raise InvalidInputError(
                f"loop: joint {self.robot.joint_names[k]!r} goes to {end:.4g}, outside its limits"
                f" [{limits.lower[k]:g}, {limits.upper[k]:g}]"
            )

    @property
    def loop(self) -> JointLoop:
        """One round of all joints (nv-6)."""
        return JointLoop(self.robot.limits.joint_positions(self.posture), self.coefficients)

    @property
    def duration(self) -> float:
        """From rest to rest [s]."""
        return self.cycles * self.period

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return posture (nq,), rate and acceleration (nv,) at a time [s]; at rest outside."""
        x = min(max(t / self.duration, 0.0), 1.0)
        total = 2.0 * np.pi * self.cycles
        slope, curvature = minimum_jerk_rates(x)
        phase, speed = np.array([total * minimum_jerk(x)]), total * slope / self.duration
        change = total * curvature / self.duration**2
        moved, first, acceleration = np.zeros((3, self.robot.nv))
        loop = self.loop
        moved[BASE_NV:] = loop.at(phase)[0] - loop.start
        first[BASE_NV:], second = loop.at(phase, 1)[0], loop.at(phase, 2)[0]
        acceleration[BASE_NV:] = speed**2 * second + change * first[BASE_NV:]
        return self.robot.integrate(self.posture, moved, 1.0), speed * first, acceleration

    def target(self) -> dict[str, Any]:
        """Return the target of a posture task in a problem file."""
        rows = zip(self.robot.joint_names, self.coefficients.T.round(DIGITS).tolist(), strict=True)
        loop = {name: values for name, values in rows if any(values)}
        return {"loop": loop, "cycles": self.cycles, "period": self.period}
